// One job: how far it is, what came of it, and everything to take along.

import { useEffect, useState } from 'preact/hooks';
import { get, sentence, words } from '../api/client';
import type { Cloud, Job, Report, Snapshot } from '../api/types';
import { between, duration, many, percent, remaining } from '../format';
import { Badge, Panel, Progress, Time, title, Trouble } from '../parts/basic';
import { CurvesPanel } from '../parts/curves';
import { KeepPanel } from '../parts/keeping';
import { Snippets } from '../parts/snippets';
import { Downloads } from '../parts/take';
import { differences } from '../parts/settings';
import { ReportPanel } from '../parts/report';
import { Priority, standing } from '../parts/waits';
import { cancel, remove, retry } from '../state/actions';
import { useCloud } from '../state/cloud';
import { useJob, type Watched } from '../state/job';
import { active } from '../state/jobs';
import { loadLimits } from '../state/limits';
import { loadPresets, preset } from '../state/presets';
import { may } from '../state/session';
import { go, href, route } from '../state/route';
import { say } from '../parts/say';
import { fetchMesh, fetchPoints, type Mesh, type Points } from '../viewer/ply';
import { View } from '../viewer/view';
import { PHASE, PHASES } from '../words';

/** More triangles than this are shown when they are asked for: not every graphics card has room. */
const MANY_TRIANGLES = 2_000_000;

export function JobPage() {
  const { id } = route.value;
  const { job, failure, warnings, snapshots, renew } = useJob(id);
  if (failure) return <><h1 tabIndex={-1}>Job</h1><Trouble>{failure.message}</Trouble><a href={href('jobs')}>To the jobs</a></>;
  if (!job) return <h1 tabIndex={-1}>Job</h1>;
  return <Found job={job} warnings={job.warnings ?? warnings} snapshots={snapshots} renew={renew} />;
}

function Found({ job, warnings, snapshots, renew }: Pick<Watched, 'warnings' | 'snapshots'> & { job: Job; renew: (job: Job) => void }) {
  const report = useReport(job);
  const cloud = useCloud(job);
  useEffect(() => {
    void loadPresets();
    void loadLimits();
  }, []);
  return (
    <>
      <div class="page-head">
        <h1 tabIndex={-1} class="clamp">{title(job)}</h1>
        <Badge of={job.status} />
        <Actions job={job} />
      </div>
      <p class="muted">
        Preset {job.preset}, submitted <Time at={job.created_at} />
        {job.started_at && job.finished_at && <>, took {duration(between(job.started_at, job.finished_at))}</>}
        {job.hold && <>, held: it cannot be erased until it is let go</>}
        {!job.hold && job.expires_at && <>, will be erased <Time at={job.expires_at} /></>}
        {job.derived_from && <>, a retry of <a href={href(`jobs/${job.derived_from}`)}>this job</a></>}
        {Object.entries(job.labels).filter(([name]) => name !== 'file').map(([name, value]) => (
          <> <a class="chip" href={href('jobs', { label: `${name}:${value}` })}>{name}: {value}</a></>
        ))}
      </p>
      {active(job.status) && <Steps job={job} />}
      {job.error && <Trouble><strong>{sentence(job.error.title)}</strong> {sentence(job.error.detail)}
        {job.error.retryable && ' Retry may help.'}</Trouble>}
      {job.status === 'cancelled' && <p>The job was cancelled; there is no mesh.</p>}
      <div class="two">
        <div>
          <Picture job={job} cloud={cloud} snapshots={snapshots} scale={report?.surface?.support_distance ?? null} />
          <CurvesPanel job={job} />
          <Snippets job={job} cloud={cloud} />
        </div>
        <div class="side">
          {job.status === 'succeeded' && <ReportPanel job={job} report={report} />}
          {job.status === 'succeeded' && <Downloads job={job} />}
          {warnings.length > 0 && (
            <Panel title="Warnings">
              <ul class="plain-list">{warnings.map(({ message }) => <li>{sentence(message)}</li>)}</ul>
            </Panel>
          )}
          <Differences job={job} />
          {may('delete') && <KeepPanel job={job} onChange={renew} />}
        </div>
      </div>
    </>
  );
}

function useReport(job: Job): Report | null {
  const [report, setReport] = useState<Report | null>(null);
  useEffect(() => {
    if (job.status !== 'succeeded') return;
    get<Report>(`/v1/jobs/${job.id}/report`).then(setReport, (error: unknown) => say(words(error)));
  }, [job.id, job.status]);
  return report;
}

function Actions({ job }: { job: Job }) {
  const again = () => void retry(job.id).then(
    (next) => go(href(`jobs/${next.id}`)),
    (error: unknown) => say(words(error)),
  );
  return (
    <div class="buttons end">
      {may('write') && (active(job.status)
        ? <button type="button" disabled={job.cancel_requested} onClick={() => void cancel([job.id])}>
          {job.cancel_requested ? 'Stopping…' : 'Cancel'}</button>
        : job.links['cloud'] && <button type="button" onClick={again}>Retry</button>)}
      {may('write') && job.links['cloud'] && <a class="button" href={href('new', { cloud_id: job.cloud_id, name: job.labels['file'] })}>New from this cloud</a>}
      {job.status === 'succeeded' && <a class="button" href={href('compare', { a: job.id })}>Compare</a>}
      {may('delete') && <button type="button" class="danger" onClick={() => void remove([job.id]).then((gone) => {
        if (gone) go(href('jobs'));
      })}>Delete</button>}
    </div>
  );
}

/** Where the job is: each phase in turn, and how long it still takes. */
function Steps({ job }: { job: Job }) {
  const at = job.phase ? PHASES.indexOf(job.phase) : -1;
  return (
    <section class="panel steps-panel" aria-label="Progress">
      <ol class="steps">
        {PHASES.map((phase, i) => {
          const state = i < at ? 'done' : i === at ? 'now' : 'ahead';
          return (
            <li class={state} aria-current={state === 'now' ? 'step' : undefined}>
              <span aria-hidden="true">{state === 'done' ? '✓' : i + 1}</span> {PHASE[phase]}
              {state === 'done' && <span class="unseen">, done</span>}
            </li>
          );
        })}
      </ol>
      <Progress share={job.progress} label="Progress of the job" />
      <p class="muted">
        {job.status === 'queued'
          ? `${['Waits for a worker', ...standing(job)].join(', ')}. `
          : `${percent(job.progress)}${job.eta_seconds !== null ? `, ${remaining(job.eta_seconds)}` : ''}`}
        <Priority job={job} />
        {job.attempt > 1 && ` Attempt ${job.attempt}.`}
      </p>
    </section>
  );
}

function Picture({ job, cloud, snapshots, scale }: { job: Job; cloud: Cloud | null; snapshots: number; scale: number | null }) {
  const [points, setPoints] = useState<Points | null>(null);
  const [mesh, setMesh] = useState<Mesh | null>(null);
  const [trouble, setTrouble] = useState('');
  const [asked, setAsked] = useState(false);
  const looks = useSnapshots(job, snapshots);
  const [chosen, setChosen] = useState<number | null>(null);
  const triangles = job.mesh?.triangles ?? 0;
  const large = triangles > MANY_TRIANGLES && !asked;
  const newest = looks.at(-1)?.evaluation ?? null;
  const shown = chosen ?? (job.status === 'succeeded' ? null : newest);
  const address = shown !== null
    ? `/v1/jobs/${job.id}/snapshots/${shown}.ply`
    : job.status === 'succeeded' && !large ? `/v1/jobs/${job.id}/mesh.ply` : null;
  useEffect(() => {
    // An erased cloud has no points; its mesh can be looked at all the same.
    if (job.links['cloud']) fetchPoints(job.cloud_id).then(setPoints, (error: unknown) => setTrouble(words(error)));
  }, [job.cloud_id]);
  useEffect(() => {
    let gone = false;
    if (address) fetchMesh(address).then(
      // An older step that comes late does not replace a newer one.
      (found) => { if (!gone) setMesh(found); },
      (error: unknown) => setTrouble(words(error)),
    );
    return () => { gone = true; };
  }, [address]);
  return (
    <Panel title="Mesh and points" aside={looks.length > 0 && (
      <label class="inline">Shown
        <select value={shown === null ? '' : String(shown)} onChange={({ currentTarget: { value } }) => setChosen(value ? Number(value) : null)}>
          {looks.map(({ evaluation }) => <option value={String(evaluation)}>Step {evaluation}</option>)}
          {job.status === 'succeeded' && <option value="">Final mesh</option>}
        </select>
      </label>
    )}>
      {large && job.status === 'succeeded' && (
        <p>{many(triangles, 'triangle')} may be more than this computer shows at ease.{' '}
          <button type="button" onClick={() => setAsked(true)}>Show them</button></p>
      )}
      {trouble && <Trouble>{trouble}</Trouble>}
      <View name={title(job)} mesh={mesh} points={points} scale={scale} frame={job.frame ?? cloud?.frame} unit={job.unit ?? cloud?.unit} />
    </Panel>
  );
}

/** Meshes at chosen evaluations, as they come. */
function useSnapshots(job: Job, arrived: number): Snapshot[] {
  const [found, setFound] = useState<Snapshot[]>([]);
  useEffect(() => {
    get<{ items: Snapshot[] }>(`/v1/jobs/${job.id}/snapshots`).then(({ items }) => setFound(items), () => undefined);
  }, [job.id, job.status, arrived]);
  return found;
}

function Differences({ job }: { job: Job }) {
  const entry = preset(job.preset);
  const found = entry ? differences(job.settings, entry.settings) : [];
  return (
    <Panel title="Settings">
      {found.length === 0
        ? <p>All as in the preset {job.preset}.</p>
        : (
          <table class="small-table">
            <thead><tr><th scope="col">Setting</th><th scope="col">Here</th><th scope="col">{job.preset}</th></tr></thead>
            <tbody>{found.map(({ name, here, there }) => (
              <tr><th scope="row">{name}</th><td>{here || 'none'}</td><td>{there || 'none'}</td></tr>
            ))}</tbody>
          </table>
        )}
    </Panel>
  );
}
