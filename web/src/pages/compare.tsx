// Two jobs side by side: what they were asked, how they trained, what came of it.

import { useEffect, useMemo, useRef, useState } from 'preact/hooks';
import { get, words } from '../api/client';
import type { Job, JobPage as Page, Report } from '../api/types';
import { count, duration, measure, number } from '../format';
import { Badge, Panel, short, title, Trouble } from '../parts/basic';
import { Chart, type Curve } from '../parts/chart';
import { Series } from '../parts/series';
import { differences } from '../parts/settings';
import { losses, useCurves } from '../state/curves';
import { href, replace, route } from '../state/route';
import { distances } from '../viewer/distance';
import { fetchMesh, fetchPoints, type Mesh, type Points } from '../viewer/ply';
import type { Scene, Triple } from '../viewer/scene';
import { View } from '../viewer/view';
import { VERDICT } from '../words';

/** More triangles than this take too long to measure while one waits. */
const MANY_TRIANGLES = 500_000;

export function ComparePage() {
  const { query } = route.value;
  const label = query.get('label');
  const [a, b] = [query.get('a') ?? '', query.get('b') ?? ''];
  const [jobs, setJobs] = useState<Job[]>([]);
  const [trouble, setTrouble] = useState('');
  useEffect(() => {
    get<Page>('/v1/jobs?status=succeeded&limit=200').then(({ items }) => setJobs(items), (error: unknown) => setTrouble(words(error)));
  }, []);
  const choose = (text: string, key: 'a' | 'b', value: string) => (
    <label>{text}
      <select value={value} onChange={({ currentTarget }) => replace(href('compare', { label: label ?? undefined, a, b, [key]: currentTarget.value }))}>
        <option value="">Choose a job</option>
        {value && !jobs.some(({ id }) => id === value) && <option value={value}>Job {short(value)}</option>}
        {jobs.map((job) => <option value={job.id}>{title(job)}, {job.preset}, {short(job.id)}</option>)}
      </select>
    </label>
  );
  return (
    <>
      <div class="page-head"><h1 tabIndex={-1}>Compare</h1></div>
      {trouble && <Trouble>{trouble}</Trouble>}
      {label && <Series label={label} />}
      <div class="filters">{choose('First job', 'a', a)}{choose('Second job', 'b', b)}</div>
      {a && b ? <Pair key={`${a}/${b}`} ids={[a, b]} /> : <p class="muted">{label ? 'Two of them, or of all others, can be looked at side by side.' : 'Choose two jobs that have succeeded.'}</p>}
    </>
  );
}

interface Side {
  job: Job;
  report: Report;
  mesh: Mesh;
  points: Points | null;
}

interface Both {
  sides: [Side, Side];
  /** Distance that nearly all of each mesh has to the other one at most; null where it was not measured. */
  apart: number | null;
}

async function load(id: string): Promise<Side> {
  const [job, report, mesh] = await Promise.all([
    get<Job>(`/v1/jobs/${id}`), get<Report>(`/v1/jobs/${id}/report`), fetchMesh(`/v1/jobs/${id}/mesh.ply`),
  ]);
  // The cloud may be erased; its mesh can be looked at all the same.
  return { job, report, mesh, points: await fetchPoints(job.cloud_id).catch(() => null) };
}

/** Largest distance of the points' support: beyond it both surfaces are made up. */
function scaleOf(sides: [Side, Side]): number | null {
  return Math.max(...sides.map(({ report }) => report.surface?.support_distance ?? 0)) || null;
}

/** The share of a mesh that may be further from the other one than the last colour says. */
const OUTLIERS = 0.01;

/** Finds how far each mesh is from the other. */
function measured(sides: [Side, Side]): Both {
  const [a, b] = [sides[0].mesh, sides[1].mesh];
  const most = 3 * (scaleOf(sides) ?? 0);
  if (most <= 0 || Math.max(a.index.length, b.index.length) / 3 > MANY_TRIANGLES) return { sides, apart: null };
  const [ofA, ofB] = [distances(a, b, most), distances(b, a, most)];
  [a.toOther, b.toOther] = [ofA, ofB];
  const usual = [ofA, ofB].map((of) => of.slice().sort()[Math.floor(of.length * (1 - OUTLIERS))] ?? 0);
  // The same mesh twice has no distance.
  return { sides, apart: Math.max(...usual) || most / 300 };
}

function Pair({ ids }: { ids: [string, string] }) {
  const [both, setBoth] = useState<Both | null>(null);
  const [trouble, setTrouble] = useState('');
  useEffect(() => {
    Promise.all([load(ids[0]), load(ids[1])]).then((loaded) => setBoth(measured(loaded)), (error: unknown) => setTrouble(words(error)));
  }, []);
  if (trouble) return <Trouble>{trouble}</Trouble>;
  if (!both) return <p role="status">Loading…</p>;
  const { sides } = both;
  return (
    <>
      <Pictures {...both} />
      {both.apart === null && <p class="muted">How far the meshes are from each other is measured up to {count(MANY_TRIANGLES)} triangles.</p>}
      <div class="halves">
        <Numbers sides={sides} />
        <SettingsPanel sides={sides} />
      </div>
      <CurvesPanel ids={ids} />
    </>
  );
}

/** Both pictures, turned together. */
function Pictures({ sides, apart }: Both) {
  const scenes = useRef<[Scene | null, Scene | null]>([null, null]);
  const leads = useRef(false);
  const origin: Triple = sides[0].mesh.origin;
  const scale = scaleOf(sides);
  const link = (i: 0 | 1) => (scene: Scene | null) => {
    scenes.current[i] = scene;
    if (!scene) return;
    scene.onTurn = (position, target) => {
      // The one that follows shall not lead in its turn.
      if (leads.current) return;
      leads.current = true;
      scenes.current[1 - i as 0 | 1]?.follow(position, target);
      leads.current = false;
    };
  };
  return (
    <div class="halves">
      {sides.map(({ job, mesh, points }, i) => (
        <Panel title={`${i === 0 ? 'First' : 'Second'}: ${title(job)}`} aside={job.verdict && <Badge of={job.verdict} />}>
          <View name={`${i === 0 ? 'First' : 'Second'}, ${title(job)}`} mesh={mesh} points={points} scale={scale} apart={apart} origin={origin}
            frame={job.frame} unit={job.unit}
            onScene={link(i as 0 | 1)} compact />
        </Panel>
      ))}
    </div>
  );
}

function Numbers({ sides }: { sides: [Side, Side] }) {
  const rows: [string, (side: Side) => string][] = [
    ['Job', ({ job }) => `${title(job)} (${short(job.id)})`],
    ['Preset', ({ job }) => job.preset],
    ['Verdict', ({ job }) => (job.verdict ? VERDICT[job.verdict] : '–')],
    ['Triangles', ({ report }) => count(report.mesh?.triangles ?? 0)],
    ['Closed', ({ report }) => (report.mesh?.closed ? 'yes' : 'no')],
    ['Pieces', ({ report }) => count(report.mesh?.components ?? 0)],
    ['Volume', ({ job, report }) => measure(report.mesh?.volume, job.unit, 3)],
    ['Area', ({ job, report }) => measure(report.mesh?.area, job.unit, 2)],
    ['Points to mesh, mean', ({ job, report }) => measure(report.distances?.cloud_to_mesh?.mean, job.unit)],
    ['Points to mesh, 95 of 100', ({ job, report }) => measure(report.distances?.cloud_to_mesh?.p95, job.unit)],
    ['Filled in, % of area', ({ report }) => number(report.surface?.unsupported_area_percent)],
    ['Loss', ({ report }) => number(report.training?.loss)],
    ['Time', ({ report }) => duration(report.seconds?.total ?? 0)],
  ];
  return (
    <Panel title="Results">
      <table class="small-table">
        <thead><tr><th scope="col">Quantity</th><th scope="col">First</th><th scope="col">Second</th></tr></thead>
        <tbody>{rows.map(([name, of]) => {
          const [here, there] = [of(sides[0]), of(sides[1])];
          return <tr class={here === there ? '' : 'differs'}><th scope="row">{name}</th><td>{here}</td><td>{there}</td></tr>;
        })}</tbody>
      </table>
    </Panel>
  );
}

function SettingsPanel({ sides }: { sides: [Side, Side] }) {
  const found = differences(sides[0].job.settings, sides[1].job.settings);
  return (
    <Panel title="Settings that differ">
      {found.length === 0 ? <p>All settings are the same.</p> : (
        <table class="small-table">
          <thead><tr><th scope="col">Setting</th><th scope="col">First</th><th scope="col">Second</th></tr></thead>
          <tbody>{found.map(({ name, here, there }) => (
            <tr><th scope="row">{name}</th><td>{here || 'none'}</td><td>{there || 'none'}</td></tr>
          ))}</tbody>
        </table>
      )}
    </Panel>
  );
}

function CurvesPanel({ ids }: { ids: [string, string] }) {
  const first = useCurves(ids[0], 'succeeded');
  const second = useCurves(ids[1], 'succeeded');
  const curves = useMemo<Curve[]>(() => [
    { label: 'First', color: 'curve-1', ...losses(first, false) },
    { label: 'Second', color: 'curve-2', dashed: true, ...losses(second, false) },
  ], [first, second]);
  return <Panel title="Loss"><Chart curves={curves} log xLabel="Evaluations" /></Panel>;
}
