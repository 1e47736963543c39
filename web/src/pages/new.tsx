// A new job: files, a preset, the settings that differ, and what it will take.

import { useEffect, useState } from 'preact/hooks';
import { Failure, get, post, sentence, words } from '../api/client';
import type { Cloud, DryRun, Estimate, Job, NewJob, PresetName, Settings } from '../api/types';
import { bytes, count, duration, many, number, percent } from '../format';
import { Panel, Progress, Trouble } from '../parts/basic';
import { ChooseFiles } from '../parts/drop';
import { say } from '../parts/say';
import { asSettings, SettingsForm, type Changes } from '../parts/settings';
import { clear, discard, drafts, ready, reuse, underway, type Draft } from '../state/drafts';
import { loadPresets, preset as presetOf } from '../state/presets';
import { go, href, route } from '../state/route';
import { PRESETS } from '../words';

/** Quiet time after a change before the estimate is asked for. */
const PAUSE_MS = 250;

/** Evaluations at which the mesh is shown while it trains. */
const LOOKS = [20, 50, 100, 200];

/** The schemes of the publication, and when their gradients are looked at. */
const SCHEMES = ['plain', 'resnet', 'highway', 'hw', 'sqrhw'];
const GRADIENTS = [10, 100];

interface Plan {
  preset: PresetName;
  changes: Changes;
  watch: boolean;
  /** Whether there is a job for each scheme, to be compared. */
  schemes: boolean;
  labels: string;
}

/** Those of the evaluations that the training can reach. */
function reached({ preset, changes }: Plan, evaluations: number[]): string {
  const most = Number(changes['training.max_evaluations'] ?? presetOf(preset)?.settings.training?.max_evaluations);
  return evaluations.filter((evaluation) => !(evaluation > most)).join(', ');
}

function settingsOf(plan: Plan): Settings {
  const looks: Changes = plan.watch ? { 'training.snapshot_evaluations': reached(plan, LOOKS) } : {};
  return asSettings({ ...looks, ...plan.changes });
}

/** Labels as they are typed: name:value, several with commas between them. */
function labelsOf(text: string): Record<string, string> {
  const pairs = text.split(',').map((pair) => pair.trim()).filter(Boolean);
  return Object.fromEntries(pairs.map((pair) => {
    const [name = '', ...value] = pair.split(':');
    return [name.trim(), value.join(':').trim()];
  }));
}

export function NewPage() {
  const [plan, setPlan] = useState<Plan>({ preset: 'balanced', changes: {}, watch: false, schemes: false, labels: '' });
  const [failure, setFailure] = useState<Failure | null>(null);
  const [sending, setSending] = useState(false);
  const wanted = route.value.query.get('cloud_id');
  useEffect(() => {
    void loadPresets();
    if (wanted) {
      const name = route.value.query.get('name') ?? `Cloud ${wanted.slice(-8)}`;
      get<Cloud>(`/v1/clouds/${wanted}`).then((cloud) => reuse(cloud, name), (error) => say(words(error)));
    }
  }, [wanted]);
  const clouds = ready.value.flatMap(({ cloud }) => cloud ?? []);
  const estimate = useEstimate(plan, clouds[0]);
  const change = (next: Partial<Plan>) => {
    setFailure(null);
    setPlan({ ...plan, ...next });
  };
  const faults = failure?.faults ?? estimate.failure?.faults ?? new Map<string, string>();
  const start = async () => {
    setSending(true);
    try {
      const jobs: Job[] = [];
      const experiment = crypto.getRandomValues(new Uint32Array(1))[0]?.toString(16) ?? '0';
      for (const draft of ready.value) {
        for (const variant of variants(plan, experiment)) jobs.push(await submit(variant, draft));
      }
      clear();
      if (plan.schemes) go(href('compare', { label: `experiment:${experiment}` }));
      else go(jobs.length === 1 ? href(`jobs/${jobs[0]?.id}`) : href('jobs'));
      say(`${many(jobs.length, 'job')} submitted.`);
    } catch (error) {
      setFailure(error instanceof Failure ? error : new Failure(words(error), 0, null));
    } finally {
      setSending(false);
    }
  };
  const some = clouds.length > 0;
  const total = clouds.length * (plan.schemes ? SCHEMES.length : 1);
  return (
    <>
      <div class="page-head"><h1 tabIndex={-1}>New job</h1></div>
      <form class="two" onSubmit={(event) => {
        event.preventDefault();
        if (some && !sending) void start();
      }}>
        <div>
          <Files />
          <PresetChoice value={plan.preset} onChange={(name) => change({ preset: name, changes: {} })} />
          <Panel title="Settings">
            <label class="check">
              <input type="checkbox" checked={plan.schemes} onChange={({ currentTarget }) => change({ schemes: currentTarget.checked })} />
              One job for each of the five schemes of the publication, side by side
            </label>
            <label class="check">
              <input type="checkbox" checked={plan.watch} onChange={({ currentTarget }) => change({ watch: currentTarget.checked })} />
              Show the mesh while it trains (takes a little longer)
            </label>
            <div class="field">
              <label for="labels">Labels, to find the job again</label>
              <input id="labels" type="text" placeholder="patient:p7, study:knee" autocomplete="off" value={plan.labels}
                aria-invalid={faults.has('/labels')} aria-describedby={faults.has('/labels') ? 'labels-fault' : undefined}
                onInput={({ currentTarget }) => change({ labels: currentTarget.value })} />
              {faults.has('/labels') && <p id="labels-fault" class="fault">{faults.get('/labels')}</p>}
            </div>
            <SettingsForm preset={presetOf(plan.preset)} changes={plan.changes} faults={faults}
              onChange={(changes) => change({ changes })} />
          </Panel>
        </div>
        <div class="side">
          <EstimatePanel estimate={estimate.value} trouble={failure ?? estimate.failure} />
          <button type="submit" class="primary large" disabled={!some || sending || underway.value || faults.size > 0}>
            {underway.value ? 'Uploading…' : total > 1 ? `Start ${total} jobs` : 'Start'}
          </button>
          {!some && !underway.value && <p class="muted">Choose a point cloud first.</p>}
        </div>
      </form>
    </>
  );
}

/** The plan itself, or one for each scheme. */
function variants(plan: Plan, experiment: string): Plan[] {
  if (!plan.schemes) return [plan];
  return SCHEMES.map((scheme) => ({
    ...plan,
    changes: { 'training.histogram_evaluations': reached(plan, GRADIENTS), ...plan.changes, 'network.scheme': scheme },
    labels: `${plan.labels}, experiment:${experiment}, scheme:${scheme}`,
  }));
}

function submit(plan: Plan, draft: Draft): Promise<Job> {
  const request: NewJob = {
    preset: plan.preset,
    settings: settingsOf(plan),
    labels: { file: draft.name.slice(0, 64), ...labelsOf(plan.labels) },
  };
  if (draft.cloud) request.cloud_id = draft.cloud.id;
  return post<Job>('/v1/jobs', request);
}

function useEstimate(plan: Plan, cloud: Cloud | undefined) {
  const [found, setFound] = useState<{ value: Estimate | null; failure: Failure | null }>({ value: null, failure: null });
  const request = JSON.stringify({ cloud_id: cloud?.id, preset: plan.preset, settings: settingsOf(plan) });
  useEffect(() => {
    const stop = new AbortController();
    const timer = setTimeout(async () => {
      try {
        const { estimate } = await post<DryRun>('/v1/jobs?dry_run=true', JSON.parse(request), stop.signal);
        setFound({ value: estimate, failure: null });
      } catch (error) {
        if (error instanceof Failure) setFound({ value: null, failure: error });
      }
    }, PAUSE_MS);
    return () => {
      clearTimeout(timer);
      stop.abort();
    };
  }, [request]);
  return found;
}

function Files() {
  return (
    <Panel title="Point clouds">
      {drafts.value.length === 0 && <p class="muted">Drop files anywhere on this page, or choose them. Points at most 5 million.</p>}
      <ul class="files">{drafts.value.map((draft) => <File key={draft.key} draft={draft} />)}</ul>
      <ChooseFiles label={drafts.value.length > 0 ? 'Add files…' : 'Choose files…'} />
    </Panel>
  );
}

function File({ draft }: { draft: Draft }) {
  const { cloud, trouble, name } = draft;
  return (
    <li>
      <div class="file-line">
        <strong class="clamp">{name}</strong>
        <button type="button" class="plain small" aria-label={`Remove ${name}`} onClick={() => discard(draft)}>✕</button>
      </div>
      {trouble && <Trouble>{trouble}</Trouble>}
      {!cloud && !trouble && (
        <span class="running-line"><Progress share={draft.progress} label={`Upload of ${name}`} /> {percent(draft.progress)}</span>
      )}
      {cloud && <span class="muted">{described(cloud)}</span>}
      {cloud?.warnings?.map(({ message }) => <p class="hint">{sentence(message)}</p>)}
    </li>
  );
}

function described(cloud: Cloud): string {
  const parts = [many(cloud.points, 'point'), bytes(cloud.bytes), cloud.format.toUpperCase()];
  if (cloud.normals) parts.push('with normals');
  const { interior = 0, exterior = 0 } = cloud.labels ?? {};
  if (interior + exterior > 0) parts.push(`${count(interior)} inside, ${count(exterior)} outside`);
  if (cloud.bounds) {
    const { min, max } = cloud.bounds;
    parts.push(min.map((low, axis) => number((max[axis] ?? low) - low)).join(' × '));
  }
  return parts.join(', ');
}

function PresetChoice({ value, onChange }: { value: PresetName; onChange: (name: PresetName) => void }) {
  return (
    <fieldset class="presets">
      <legend>Preset</legend>
      {PRESETS.map(({ name, title, text }) => (
        <label class={name === value ? 'chosen' : ''}>
          <input type="radio" name="preset" value={name} checked={name === value} onChange={() => onChange(name)} />
          <strong>{title}</strong>
          <span>{text}</span>
        </label>
      ))}
    </fieldset>
  );
}

function EstimatePanel({ estimate, trouble }: { estimate: Estimate | null; trouble: Failure | null }) {
  return (
    <Panel title="Estimate">
      {trouble && (
        <Trouble>
          {trouble.faults.size === 0 ? trouble.message : [...trouble.faults].map(([pointer, detail]) => (
            <span class="line">{pointer.replace(/^\/(settings\/)?/, '').replaceAll('/', '.')} {sentence(detail).replace(/^./, (first) => first.toLowerCase())}</span>
          ))}
        </Trouble>
      )}
      {estimate && (
        <dl class="numbers">
          <div><dt>Time</dt><dd>{duration(estimate.seconds)}</dd></div>
          <div><dt>Memory</dt><dd>{bytes(estimate.memory_bytes)}</dd></div>
          <div><dt>Triangles</dt><dd>{count(estimate.triangles)}</dd></div>
          <div><dt>Trained numbers</dt><dd>{count(estimate.parameters)}</dd></div>
          <div><dt>Samples</dt><dd>{count(estimate.samples)}</dd></div>
        </dl>
      )}
      <p class="help">As it usually is for exact points; noisy or large clouds take longer.</p>
    </Panel>
  );
}
