// All jobs, live. Only the rows in sight are in the page: ten thousand jobs are as fast as ten.

import { computed, signal, type Signal } from '@preact/signals';
import { useEffect, useLayoutEffect, useRef, useState } from 'preact/hooks';
import type { Row } from '../api/types';
import { duration, many, number, between, percent, remaining } from '../format';
import { Badge, Kept, Progress, short, Time, title, Trouble } from '../parts/basic';
import { ChooseFiles } from '../parts/drop';
import { Priority, standing } from '../parts/waits';
import { cancel, cancelLabelled, hold, remove, removeLabelled } from '../state/actions';
import { active, complete, loading, more, rows, show, trouble, type Filters } from '../state/jobs';
import { href, replace, route } from '../state/route';
import { may } from '../state/session';
import { PHASE, STATUS, VERDICT } from '../words';

/** Height of a row, which the style sheet has too. */
const ROW = 64;

/** Rows beyond the window that are there already. */
const SPARE = 8;

const chosen = signal<ReadonlySet<string>>(new Set());
const chosenRows = computed(() => rows.value.filter((row) => chosen.value.has(row.value.id)).map((row) => row.value));

function choose(ids: string[], yes: boolean): void {
  const next = new Set(chosen.value);
  for (const id of ids) {
    if (yes) next.add(id);
    else next.delete(id);
  }
  chosen.value = next;
}

function filtersOf(query: URLSearchParams): Filters {
  const given = (name: string) => query.get(name) ?? undefined;
  return { status: given('status'), verdict: given('verdict'), label: given('label'), cloud_id: given('cloud_id') };
}

export function JobsPage() {
  const search = route.value.query.toString();
  const filters = filtersOf(route.value.query);
  const filtered = Object.values(filters).some(Boolean);
  useEffect(() => {
    chosen.value = new Set();
    void show(filtersOf(new URLSearchParams(search)));
  }, [search]);
  return (
    <>
      <div class="page-head">
        <h1 tabIndex={-1}>Jobs</h1>
        {may('write') && <ChooseFiles label="Choose files…" primary />}
      </div>
      {(filtered || rows.value.length > 0 || !complete.value) && <FilterBar filters={filters} />}
      {filters.label && Object.values(filters).filter(Boolean).length === 1 && rows.value.length > 0 && <Labelled label={filters.label} />}
      {trouble.value && <Trouble>{trouble.value}</Trouble>}
      {chosenRows.value.length > 0 && <Bulk />}
      {rows.value.length > 0 ? <Table /> : <Nothing filtered={filtered} />}
    </>
  );
}

function FilterBar({ filters }: { filters: Filters }) {
  const [label, setLabel] = useState(filters.label ?? '');
  const [fault, setFault] = useState('');
  useEffect(() => setLabel(filters.label ?? ''), [filters.label]);
  const set = (change: Filters) => replace(href('jobs', { ...filters, ...change }));
  const setByLabel = () => {
    const text = label.trim();
    const fits = text === '' || /^[^:]{1,64}:.{0,64}$/.test(text);
    setFault(fits ? '' : 'Write it as name:value, for instance patient:p7.');
    if (fits) set({ label: text || undefined });
  };
  const options = (words: Record<string, string>, all: string) => [
    <option value="">{all}</option>,
    ...Object.entries(words).map(([value, word]) => <option value={value}>{word}</option>),
  ];
  return (
    <form class="filters" role="search" aria-label="Filter jobs" onSubmit={(event) => {
      event.preventDefault();
      setByLabel();
    }}>
      <label>State
        <select value={filters.status ?? ''} onChange={({ currentTarget: { value } }) => set({ status: value || undefined })}>
          {options(STATUS, 'All')}
        </select>
      </label>
      <label>Verdict
        <select value={filters.verdict ?? ''} onChange={({ currentTarget: { value } }) => set({ verdict: value || undefined })}>
          {options(VERDICT, 'All')}
        </select>
      </label>
      <label>Label
        <input type="text" value={label} placeholder="patient:p7" aria-invalid={fault !== ''}
          aria-describedby={fault ? 'label-fault' : undefined} autocomplete="off" spellcheck={false}
          onInput={({ currentTarget: { value } }) => setLabel(value)} onBlur={setByLabel} />
      </label>
      {filters.cloud_id && <span class="chip">Cloud {short(filters.cloud_id)}</span>}
      {Object.values(filters).some(Boolean) && <a class="button" href={href('jobs')}>Show all</a>}
      {fault && <p id="label-fault" class="fault">{fault}</p>}
    </form>
  );
}

/** What can be done to all jobs with a label, however many there are. */
function Labelled({ label }: { label: string }) {
  const [busy, setBusy] = useState(false);
  if (!may('write') && !may('delete')) return null;
  // Thousands take a while.
  const all = (act: (label: string) => Promise<void>) => {
    setBusy(true);
    void act(label).finally(() => setBusy(false));
  };
  return (
    <div class="buttons labelled" role="group" aria-label={`All jobs with ${label}`}>
      <span>All jobs with <strong>{label}</strong></span>
      {may('write') && <button type="button" class="small" disabled={busy} onClick={() => all(cancelLabelled)}>Cancel all</button>}
      {may('delete') && <button type="button" class="small danger" disabled={busy} onClick={() => all(removeLabelled)}>Delete all</button>}
      {busy && <span role="status" class="muted">At work…</span>}
    </div>
  );
}

function Bulk() {
  const all = chosenRows.value;
  const alive = all.filter((row) => active(row.status)).map((row) => row.id);
  const ids = all.map((row) => row.id);
  const [held, free] = [true, false].map((is) => all.filter((row) => Boolean(row.hold) === is).map((row) => row.id)) as [string[], string[]];
  const done = (changed: boolean) => {
    if (changed) chosen.value = new Set();
  };
  return (
    <div class="bulk" role="group" aria-label="Chosen jobs">
      <span role="status">{many(all.length, 'job')} chosen</span>
      {may('write') && alive.length > 0 && <button type="button" onClick={() => void cancel(alive).then(done)}>Cancel</button>}
      {may('delete') && free.length > 0 && <button type="button" onClick={() => void hold(free, true).then(done)}>Hold</button>}
      {may('delete') && held.length > 0 && <button type="button" onClick={() => void hold(held, false).then(done)}>Let go</button>}
      {may('delete') && <button type="button" class="danger" onClick={() => void remove(ids).then(done)}>Delete</button>}
      {all.length === 2 && <a class="button" href={href('compare', { a: ids[1], b: ids[0] })}>Compare</a>}
      <button type="button" class="plain" onClick={() => done(true)}>Choose none</button>
    </div>
  );
}

function Nothing({ filtered }: { filtered: boolean }) {
  if (loading.value) return <p class="empty" role="status">Loading…</p>;
  if (trouble.value) return null;
  if (filtered) return <p class="empty">No job matches. <a href={href('jobs')}>Show all jobs</a></p>;
  return (
    <div class="empty first-time">
      <p class="big">Drop a point cloud anywhere on this page.</p>
      <p>PLY, XYZ, CSV, PTS, PCD, NPY, OBJ, OFF, STL or VTK; or a segmentation: NIfTI, NRRD, MHA, DICOM SEG or RT-STRUCT. You get a closed mesh back, and how far it can be relied on.</p>
      <ChooseFiles label="Choose files…" />
    </div>
  );
}

/** Which rows are in sight, from where the table is in the window. */
function useWindow(total: number) {
  const body = useRef<HTMLTableSectionElement>(null);
  const [range, setRange] = useState({ from: 0, to: 40 });
  useLayoutEffect(() => {
    let frame = 0;
    const measure = () => {
      frame = 0;
      const top = body.current?.getBoundingClientRect().top ?? 0;
      const from = Math.max(0, Math.floor(-top / ROW) - SPARE);
      const to = Math.min(total, Math.ceil((innerHeight - top) / ROW) + SPARE);
      setRange((old) => (old.from === from && old.to === to ? old : { from, to }));
      if (to >= total - SPARE) void more();
    };
    const soon = () => {
      if (frame === 0) frame = requestAnimationFrame(measure);
    };
    measure();
    addEventListener('scroll', soon, { passive: true });
    addEventListener('resize', soon);
    return () => {
      cancelAnimationFrame(frame);
      removeEventListener('scroll', soon);
      removeEventListener('resize', soon);
    };
  }, [total]);
  return { body, from: Math.min(range.from, total), to: Math.min(range.to, total) };
}

function Table() {
  const all = rows.value;
  const { body, from, to } = useWindow(all.length);
  const ids = all.map((row) => row.peek().id);
  const every = ids.every((id) => chosen.value.has(id));
  const gap = (count: number) => count > 0 && (
    <tr aria-hidden="true" class="gap"><td colSpan={5} style={{ height: `${count * ROW}px` }} /></tr>
  );
  return (
    <>
      <table class="jobs" aria-rowcount={complete.value ? all.length + 1 : -1}>
        <caption class="unseen">Jobs, newest first</caption>
        <thead>
          <tr aria-rowindex={1}>
            <th class="mark"><input type="checkbox" aria-label="Choose all jobs that are loaded" checked={every}
              onChange={({ currentTarget }) => choose(ids, currentTarget.checked)} /></th>
            <th scope="col">Job</th>
            <th scope="col">State</th>
            <th scope="col" class="wide-only">Result</th>
            <th scope="col" class="when">Submitted</th>
          </tr>
        </thead>
        <tbody ref={body}>
          {gap(from)}
          {all.slice(from, to).map((row, i) => <JobRow key={row.peek().id} row={row} index={from + i + 2} />)}
          {gap(all.length - to)}
        </tbody>
      </table>
      <p class="count" role="status">
        {complete.value ? many(all.length, 'job') : `${many(all.length, 'job')} loaded, more as you scroll`}
      </p>
    </>
  );
}

function JobRow({ row, index }: { row: Signal<Row>; index: number }) {
  const job = row.value;
  const labels = Object.entries(job.labels).filter(([name]) => name !== 'file');
  return (
    <tr aria-rowindex={index}>
      <td class="mark"><input type="checkbox" aria-label={`Choose ${title(job)}`} checked={chosen.value.has(job.id)}
        onChange={({ currentTarget }) => choose([job.id], currentTarget.checked)} /></td>
      <td class="name">
        <a href={href(`jobs/${job.id}`)}>{title(job)}</a>
        <span class="under">{job.preset}{labels.map(([name, value]) => (
          <a class="chip" href={href('jobs', { label: `${name}:${value}` })}>{name}: {value}</a>
        ))}</span>
      </td>
      <td class="state"><State job={job} /></td>
      <td class="wide-only result"><Result job={job} /></td>
      <td class="when"><Time at={job.created_at} /><span class="under"><Kept job={job} /></span></td>
    </tr>
  );
}

function State({ job }: { job: Row }) {
  if (job.status !== 'running') {
    return (
      <>
        <Badge of={job.status} /> <Priority job={job} />
        <span class="under">
          {job.status === 'queued' && <span class="clamp">{standing(job).join(', ').replace(/^n/, 'N')}</span>}
          {job.started_at && job.finished_at && duration(between(job.started_at, job.finished_at))}
        </span>
      </>
    );
  }
  return (
    <>
      <span class="running-line"><Badge of="running" /> <Progress share={job.progress} label={`Progress of ${title(job)}`} />
        {percent(job.progress)}</span>
      <span class="under">{job.phase && PHASE[job.phase]}{job.eta_seconds !== null && `, ${remaining(job.eta_seconds)}`}</span>
    </>
  );
}

function Result({ job }: { job: Row }) {
  if (job.error) return <span class="clamp">{job.error.detail}</span>;
  if (job.mesh) {
    return (
      <>
        {job.verdict && <Badge of={job.verdict} />}
        <span class="under">{many(job.mesh.triangles, 'triangle')}{job.mesh.closed ? ', closed' : ', open'}</span>
      </>
    );
  }
  return <span class="muted">{job.loss !== null && job.loss !== undefined && `loss ${number(job.loss)}`}</span>;
}
