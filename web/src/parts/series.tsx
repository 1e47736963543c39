// Jobs with a label of their own, as an experiment has them: their losses over each other, live, and
// their results in a table.

import { useEffect, useMemo, useState } from 'preact/hooks';
import { get, words } from '../api/client';
import type { Job, JobPage } from '../api/types';
import { between, count, duration, number } from '../format';
import { losses, useCurves, type Curves } from '../state/curves';
import { onEvent, onReturn } from '../state/live';
import { href } from '../state/route';
import { Badge, Panel, title, Trouble } from './basic';
import { Chart } from './chart';
import { Gradients, ofLayers } from './curves';

/** Jobs that are shown: more lines would not be told apart. */
const MOST = 8;

const COLORS = ['curve-1', 'curve-2', 'curve-3', 'curve-4'];

const named = (job: Job) => job.labels['scheme'] ?? title(job);

function useJobs(label: string) {
  const [jobs, setJobs] = useState<Job[]>([]);
  const [trouble, setTrouble] = useState('');
  useEffect(() => {
    const look = () => void get<JobPage>(`/v1/jobs?limit=${MOST}&label=${encodeURIComponent(label)}`).then(
      ({ items }) => setJobs(items.reverse()),
      (error: unknown) => setTrouble(words(error)),
    );
    look();
    const forget = [onReturn(look), onEvent(({ name }) => {
      if (/started|succeeded|failed|cancelled/.test(name)) look();
    })];
    return () => forget.forEach((stop) => stop());
  }, [label]);
  return { jobs, trouble };
}

/** What is drawn of the jobs: the losses over each other, the rest beside each other, as in the publication. */
type Choice = 'loss' | 'weights' | 'gradients';

const CHOICES: Record<Choice, string> = { loss: 'Loss', weights: 'Weight norms, by layer', gradients: 'Gradients, by layer' };

export function Series({ label }: { label: string }) {
  const { jobs, trouble } = useJobs(label);
  const [curves, setCurves] = useState<Record<string, Curves>>({});
  const [choice, setChoice] = useState<Choice>('loss');
  const drawn = useMemo(() => jobs.flatMap((job, i) => {
    const found = curves[job.id];
    if (!found) return [];
    return [{ label: named(job), color: COLORS[i % COLORS.length] ?? 'curve-1', dashed: i >= COLORS.length, ...losses(found, false) }];
  }), [jobs, curves]);
  if (trouble) return <Trouble>{trouble}</Trouble>;
  return (
    <Panel title={`Jobs with ${label}`} aside={(
      <label class="inline">Shown
        <select value={choice} onChange={({ currentTarget: { value } }) => setChoice(value as Choice)}>
          {Object.entries(CHOICES).map(([value, text]) => <option value={value}>{text}</option>)}
        </select>
      </label>
    )}>
      {jobs.map((job) => (
        <Load key={job.id} job={job} onCurves={(found) => setCurves((old) => ({ ...old, [job.id]: found }))} />
      ))}
      {choice === 'loss' && drawn.some(({ x }) => x.length > 0) && <Chart curves={drawn} log xLabel="Evaluations" />}
      {choice !== 'loss' && (
        <div class="halves">{jobs.map((job) => (
          <section key={job.id} aria-label={named(job)}>
            <h3>{named(job)}</h3>
            {choice === 'weights' ? <Weights curves={curves[job.id]} /> : <Gradients job={job} />}
          </section>
        ))}</div>
      )}
      <div class="wide-table">
        <table class="small-table">
          <thead>
            <tr>{['Job', 'State', 'Loss', 'Points to mesh, mean', 'Triangles', 'Volume', 'Time'].map((name) => <th scope="col">{name}</th>)}</tr>
          </thead>
          <tbody>{jobs.map((job) => <Line key={job.id} job={job} />)}</tbody>
        </table>
      </div>
    </Panel>
  );
}

function Weights({ curves }: { curves: Curves | undefined }) {
  const drawn = useMemo(() => (curves ? ofLayers(curves) : []), [curves]);
  return drawn.length > 0 ? <Chart curves={drawn} log={false} xLabel="Evaluations" /> : <p class="muted">There are no curves yet.</p>;
}

/** A hook for each job of a list whose length changes. */
function Load({ job, onCurves }: { job: Job; onCurves: (curves: Curves) => void }) {
  const curves = useCurves(job.id, job.status);
  useEffect(() => onCurves(curves), [curves]);
  return null;
}

function Line({ job }: { job: Job }) {
  const [mean, setMean] = useState<number | null>(null);
  useEffect(() => {
    if (job.status !== 'succeeded') return;
    get<{ distances?: { cloud_to_mesh?: { mean?: number } } | null }>(`/v1/jobs/${job.id}/report`).then(
      ({ distances }) => setMean(distances?.cloud_to_mesh?.mean ?? null),
      () => undefined,
    );
  }, [job.id, job.status]);
  const { started_at: from, finished_at: to } = job;
  return (
    <tr>
      <th scope="row"><a href={href(`jobs/${job.id}`)}>{named(job)}</a></th>
      <td><Badge of={job.verdict ?? job.status} /></td>
      <td>{number(job.loss)}</td>
      <td>{number(mean)}</td>
      <td>{job.mesh ? count(job.mesh.triangles) : '–'}</td>
      <td>{number(job.mesh?.volume)}</td>
      <td>{from && to ? duration(between(from, to)) : '–'}</td>
    </tr>
  );
}
