// A new job: files, a preset, the settings that differ, and what it will take.

import { useEffect, useState } from 'preact/hooks';
import { Failure, get, post, sentence, words } from '../api/client';
import type { Cloud, DryRun, Estimate, Job, NewJob, PresetName, Settings } from '../api/types';
import { bytes, count, duration, many } from '../format';
import { Panel, Trouble } from '../parts/basic';
import { Files } from '../parts/files';
import { KeptFor, lifetime, Turn } from '../parts/keeping';
import { say } from '../parts/say';
import { asSettings, SettingsForm, type Changes } from '../parts/settings';
import { finish, pieces, ready, reuse, underway, type Draft, type Piece } from '../state/drafts';
import { limits, loadLimits } from '../state/limits';
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
  /** How long the jobs are kept; empty: as the service has it. */
  ttl: string;
  priority: string;
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
  const [plan, setPlan] = useState<Plan>({ preset: 'balanced', changes: {}, watch: false, schemes: false, labels: '', ttl: '', priority: '0' });
  const [refused, setRefused] = useState<{ failure: Failure; of: string } | null>(null);
  const [sending, setSending] = useState(false);
  const wanted = route.value.query.get('cloud_id');
  useEffect(() => {
    void loadPresets();
    void loadLimits();
    if (wanted) {
      const name = route.value.query.get('name') ?? `Cloud ${wanted.slice(-8)}`;
      get<Cloud>(`/v1/clouds/${wanted}`).then((cloud) => reuse(cloud, name), (error) => say(words(error)));
    }
  }, [wanted]);
  const asked = next();
  const estimate = useEstimate(plan, asked);
  const change = (next: Partial<Plan>) => {
    setRefused(null);
    setPlan({ ...plan, ...next });
  };
  // What was said of another choice of files and parts counts no more.
  const failure = refused?.of === choice() ? refused.failure : null;
  const faults = failure?.faults ?? estimate.failure?.faults ?? new Map<string, string>();
  const start = async () => {
    setSending(true);
    const jobs: Job[] = [];
    const done: Piece[] = [];
    try {
      const experiment = crypto.getRandomValues(new Uint32Array(1))[0]?.toString(16) ?? '0';
      for (const piece of pieces.value) {
        for (const variant of variants(plan, experiment)) jobs.push(await post<Job>('/v1/jobs', request(variant, piece)));
        done.push(piece);
      }
      if (plan.schemes) go(href('compare', { label: `experiment:${experiment}` }));
      else go(jobs.length === 1 ? href(`jobs/${jobs[0]?.id}`) : href('jobs'));
      finish(done);
      say(`${many(jobs.length, 'job')} submitted.`);
    } catch (error) {
      finish(done);
      setRefused({ failure: error instanceof Failure ? error : new Failure(words(error), 0, null), of: choice() });
      if (jobs.length > 0) say(`${many(jobs.length, 'job')} submitted; the others are still here.`);
    } finally {
      setSending(false);
    }
  };
  const some = pieces.value.length > 0;
  const total = pieces.value.length * (plan.schemes ? SCHEMES.length : 1);
  return (
    <>
      <div class="page-head"><h1 tabIndex={-1}>New job</h1></div>
      <form class="two making" onSubmit={(event) => {
        event.preventDefault();
        if (some && !sending) void start();
      }}>
        <div>
          <Files fault={{ draft: asked?.draft.key, text: faults.get('/source') }} />
          <PresetChoice value={plan.preset} onChange={(name) => change({ preset: name, changes: {} })} />
        </div>
        <div class="side">
          <EstimatePanel estimate={estimate.value} trouble={failure ?? estimate.failure} />
          <button type="submit" class="primary large" disabled={!some || sending || underway.value || faults.size > 0}>
            {underway.value ? 'Uploading…' : total > 1 ? `Start ${total} jobs` : 'Start'}
          </button>
          {!some && !underway.value && (
            <p class="muted">{asked ? 'Choose which parts of the file become surfaces.' : 'Choose a file first.'}</p>
          )}
        </div>
        <div class="rest">
          <Panel title="Settings">
            <label class="check">
              <input type="checkbox" checked={plan.schemes} onChange={({ currentTarget }) => change({ schemes: currentTarget.checked })} />
              One job for each of the five schemes of the publication, side by side
            </label>
            <label class="check">
              <input type="checkbox" checked={plan.watch} onChange={({ currentTarget }) => change({ watch: currentTarget.checked })} />
              Show the mesh while it trains (up to twice the time)
            </label>
            <div class="field">
              <label for="labels">Labels, to find the job again</label>
              <input id="labels" type="text" placeholder="patient:p7, study:knee" autocomplete="off" value={plan.labels}
                aria-invalid={faults.has('/labels')} aria-describedby={faults.has('/labels') ? 'labels-fault' : undefined}
                onInput={({ currentTarget }) => change({ labels: currentTarget.value })} />
              {faults.has('/labels') && <p id="labels-fault" class="fault">{faults.get('/labels')}</p>}
            </div>
            <div class="fields">
              <div class="field"><label for="ttl">Kept after its end</label>
                <KeptFor id="ttl" value={plan.ttl} standard={`As usual: ${lifetime(limits.value?.job_ttl).toLowerCase()}`} onChange={(ttl) => change({ ttl })} /></div>
              <div class="field"><label for="priority">Priority in the queue</label>
                <Turn id="priority" value={plan.priority} onChange={(priority) => change({ priority })} /></div>
            </div>
            <SettingsForm preset={presetOf(plan.preset)} changes={plan.changes} faults={faults}
              onChange={(changes) => change({ changes })} />
          </Panel>
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

/** Files and parts that are chosen, as a text to tell one choice from another. */
const choice = () => pieces.value.map(({ draft, part }) => `${draft.key}/${part?.number}`).join();

/** What the estimate is asked for: a file of which nothing is chosen yet goes first, so that it is told of. */
function next(): { draft: Draft; piece: Piece } | undefined {
  const open = ready.value.find(({ key }) => !pieces.value.some(({ draft }) => draft.key === key));
  if (open?.cloud) return { draft: open, piece: { draft: open, cloud: open.cloud, part: null } };
  const piece = pieces.value[0];
  return piece && { draft: piece.draft, piece };
}

/** The beginning of a name, as long as the value of a label may be. */
const cut = (text: string) => [...text].slice(0, 64).join('');

function request(plan: Plan, { draft, cloud, part }: Piece): NewJob {
  const labels = { file: cut(draft.name), ...labelsOf(plan.labels) };
  const job: NewJob = { cloud_id: cloud.id, preset: plan.preset, settings: settingsOf(plan), labels };
  if (plan.ttl) job.ttl = plan.ttl;
  if (plan.priority !== '0') job.priority = Number(plan.priority);
  if (part) {
    job.labels = { part: cut(part.name || String(part.number)), ...labels };
    // A name can be there twice, a number cannot.
    job.source = { label: part.number };
  }
  return job;
}

function useEstimate(plan: Plan, asked: ReturnType<typeof next>) {
  const [found, setFound] = useState<{ value: Estimate | null; failure: Failure | null }>({ value: null, failure: null });
  const part = asked?.piece.part;
  const text = JSON.stringify({
    cloud_id: asked?.piece.cloud.id, preset: plan.preset, settings: settingsOf(plan), source: part ? { label: part.number } : undefined,
  });
  useEffect(() => {
    const stop = new AbortController();
    const timer = setTimeout(async () => {
      try {
        const { estimate } = await post<DryRun>('/v1/jobs?dry_run=true', JSON.parse(text), stop.signal);
        setFound({ value: estimate, failure: null });
      } catch (error) {
        if (error instanceof Failure) setFound({ value: null, failure: error });
      }
    }, PAUSE_MS);
    return () => {
      clearTimeout(timer);
      stop.abort();
    };
  }, [text]);
  return found;
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
  // What is wrong with the choice of a part stands at the file.
  const faults = [...trouble?.faults ?? []].filter(([pointer]) => pointer !== '/source');
  return (
    <Panel title="Estimate">
      {trouble && (faults.length > 0 || trouble.faults.size === 0) && (
        <Trouble>
          {faults.length === 0 ? trouble.message : faults.map(([pointer, detail]) => (
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
