// The list of jobs: pages of the API as they are scrolled to, kept current by events. Each job has a
// signal of its own, so that a job that moves draws its row and nothing else.

import { signal, type Signal } from '@preact/signals';
import { Failure, get, words } from '../api/client';
import type { Job, JobPage, Row, Status } from '../api/types';
import { onEvent, onReturn, type LiveEvent } from './live';

export interface Filters {
  status?: string | undefined;
  verdict?: string | undefined;
  label?: string | undefined;
  cloud_id?: string | undefined;
}

/** Jobs of a page of the API, the most there may be. */
const PAGE = 200;

export const rows = signal<Signal<Row>[]>([]);
export const complete = signal(false);
export const loading = signal(true);
export const trouble = signal('');

const known = new Map<string, Signal<Row>>();
let filters: Filters = {};
let cursor: string | null = null;
let generation = 0;

function slim(job: Job): Row {
  const { settings: _settings, links: _links, ...row } = job;
  return row;
}

/** The parts of `key:value`; only the value may have a colon. */
export function labelOf(text: string): [key: string, value: string] {
  const colon = text.indexOf(':');
  return [text.slice(0, colon), text.slice(colon + 1)];
}

function matches(row: Row): boolean {
  const [key, value] = filters.label ? labelOf(filters.label) : [];
  return (!filters.status || row.status === filters.status)
    && (!filters.verdict || row.verdict === filters.verdict)
    && (!filters.cloud_id || row.cloud_id === filters.cloud_id)
    && (!key || row.labels[key] === value);
}

/** Puts jobs into the list, each at its place: ids sort by time, newest first. */
function put(found: Row[]): void {
  const added: Signal<Row>[] = [];
  for (const row of found) {
    const there = known.get(row.id);
    if (there) there.value = row;
    else if (matches(row)) {
      const kept = signal(row);
      known.set(row.id, kept);
      added.push(kept);
    }
  }
  if (added.length === 0) return;
  const all = [...rows.value, ...added];
  // A further page comes behind; only what is new in front has to be sorted in.
  const last = rows.value.at(-1);
  const first = added[0];
  if (last && first && first.value.id > last.value.id) {
    all.sort((a, b) => (a.value.id < b.value.id ? 1 : -1));
  }
  rows.value = all;
}

/** Shows what a request changed of a job. */
export function renew(job: Job): void {
  const row = known.get(job.id);
  if (!row) return;
  const moved = row.peek().priority !== job.priority;
  row.value = slim(job);
  // Others gave way, or went past it.
  if (moved) void lookAgain();
}

export function forget(id: string): void {
  if (known.delete(id)) rows.value = rows.value.filter((row) => row.value.id !== id);
}

function query(after: string | null): string {
  const given = Object.entries({ ...filters, cursor: after ?? undefined }).filter(([, value]) => value);
  return new URLSearchParams([...given as [string, string][], ['limit', String(PAGE)]]).toString();
}

/** Shows the jobs that match, from the newest on. */
export async function show(next: Filters): Promise<void> {
  filters = next;
  generation += 1;
  known.clear();
  rows.value = [];
  complete.value = false;
  cursor = null;
  loading.value = false;
  await more();
}

/** Loads the next page. */
export async function more(): Promise<void> {
  if (loading.value || complete.value) return;
  const asked = generation;
  loading.value = true;
  try {
    const page = await get<JobPage>(`/v1/jobs?${query(cursor)}`);
    if (asked !== generation) return;
    put(page.items.map(slim));
    cursor = page.next_cursor;
    complete.value = cursor === null;
    trouble.value = '';
  } catch (error) {
    if (asked === generation) trouble.value = words(error);
  } finally {
    if (asked === generation) loading.value = false;
  }
}

/** Looks again at the newest jobs: what happened while there was no stream. */
export async function lookAgain(): Promise<void> {
  const asked = generation;
  try {
    const page = await get<JobPage>(`/v1/jobs?${query(null)}`);
    if (asked !== generation) return;
    // What is gone from the part that the page covers was erased, or matches no more.
    const there = new Set(page.items.map((job) => job.id));
    const oldest = page.next_cursor === null ? '' : page.items.at(-1)?.id ?? '';
    const kept = rows.value.filter(({ value: { id } }) => there.has(id) || id < oldest);
    if (kept.length < rows.value.length) {
      rows.value.filter((row) => !kept.includes(row)).forEach((row) => known.delete(row.value.id));
      rows.value = kept;
    }
    put(page.items.map(slim));
    if (page.next_cursor === null) complete.value = true;
    else if (cursor === null) cursor = page.next_cursor;
    trouble.value = '';
  } catch (error) {
    if (asked === generation) trouble.value = words(error);
  }
}

async function look(id: string): Promise<void> {
  try {
    const row = slim(await get<Job>(`/v1/jobs/${id}`));
    if (matches(row)) put([row]);
    else forget(id);
  } catch (error) {
    if (error instanceof Failure && (error.status === 404 || error.status === 410)) forget(id);
  }
}

/** What an event changes of a job that is shown; undefined where the job has to be asked for. */
export function changed<T extends Row>(row: T, { name, data }: LiveEvent): T | undefined {
  switch (name) {
    case 'job.progress':
      return { ...row, progress: data.fraction as number, eta_seconds: data.eta_seconds as number | null };
    case 'job.phase':
      return { ...row, phase: data.phase as Row['phase'] };
    case 'training.metrics':
      return { ...row, evaluations: data.evaluation as number, loss: data.loss as number | null };
    case 'job.snapshot':
    case 'job.warning':
      return row;
    default:
      return undefined;
  }
}

onEvent((event) => {
  const row = known.get(event.data.job_id);
  const next = row && changed(row.value, event);
  if (row && next) row.value = next;
  // A job that is not shown is asked for when its state changes: it may match now.
  else if (row || /queued|started|succeeded|failed|cancelled/.test(event.name)) void look(event.data.job_id);
});
onReturn(() => void lookAgain());

/** Milliseconds after which a queue that moved is looked at: jobs that are short end in crowds. */
const QUEUE_PAUSE = 1_000;

/** Milliseconds between two looks without a reason: that a job was erased is no event. */
const LONG_PAUSE = 60_000;

let pending = 0;
onEvent(({ name }) => {
  const moved = /started|succeeded|failed|cancelled/.test(name);
  if (moved && pending === 0 && rows.value.some((row) => row.peek().status === 'queued')) {
    pending = setTimeout(() => {
      pending = 0;
      void lookAgain();
    }, QUEUE_PAUSE);
  }
});
setInterval(() => {
  if (!document.hidden) void lookAgain();
}, LONG_PAUSE);

/** Whether something can still happen to a job. */
export function active(status: Status): boolean {
  return status === 'queued' || status === 'running';
}
