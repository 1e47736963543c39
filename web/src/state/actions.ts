// What can be done to jobs, each with its question where it cannot be undone.

import { erase, get, patch, post, words } from '../api/client';
import type { Erased, Job, JobPage, Status } from '../api/types';
import { many } from '../format';
import { confirm } from '../parts/confirm';
import { say } from '../parts/say';
import { forget, lookAgain, renew } from './jobs';

/** Does it to each; how many it was done to. What went wrong is said. */
async function each(ids: string[], act: (id: string) => Promise<unknown>): Promise<number> {
  let done = 0;
  let trouble = '';
  for (const id of ids) {
    try {
      await act(id);
      done += 1;
      // Many take a while.
      if (done % 25 === 0) say(`${done} of ${many(ids.length, 'job')}…`);
    } catch (error) {
      trouble = words(error);
    }
  }
  if (trouble) say(`${done} of ${many(ids.length, 'job')}. ${trouble}`);
  return done;
}

export async function cancel(ids: string[]): Promise<boolean> {
  const yes = await confirm({
    title: `Cancel ${ids.length === 1 ? 'this job' : many(ids.length, 'job')}?`,
    text: 'What was computed so far is lost. The cloud stays.',
    action: 'Cancel',
    danger: true,
  });
  if (!yes) return false;
  const done = await each(ids, (id) => post(`/v1/jobs/${id}/cancel`));
  if (done === ids.length) say(`${many(done, 'job')} cancelled.`);
  return done > 0;
}

export async function remove(ids: string[]): Promise<boolean> {
  const yes = await confirm({
    title: `Delete ${ids.length === 1 ? 'this job' : many(ids.length, 'job')}?`,
    text: 'Meshes, reports and curves are erased for good. The clouds stay.',
    action: 'Delete',
    danger: true,
  });
  if (!yes) return false;
  const done = await each(ids, async (id) => {
    await erase(`/v1/jobs/${id}`);
    forget(id);
  });
  if (done === ids.length) say(`${many(done, 'job')} deleted.`);
  return done > 0;
}

export function retry(id: string): Promise<Job> {
  return post<Job>(`/v1/jobs/${id}/retry`);
}

/** Holds jobs, so that nothing erases them, or lets them go. */
export async function hold(ids: string[], yes: boolean): Promise<boolean> {
  const done = await each(ids, async (id) => renew(await patch<Job>(`/v1/jobs/${id}`, { hold: yes })));
  if (done === ids.length) say(`${many(done, 'job')} ${yes ? 'held' : 'let go'}.`);
  return done > 0;
}

/** Ids of all jobs in this state with this label. */
async function labelled(label: string, status: Status): Promise<string[]> {
  const ids: string[] = [];
  let cursor: string | null = '';
  while (cursor !== null) {
    const query = new URLSearchParams({ label, status, limit: '200', ...(cursor ? { cursor } : {}) });
    const page: JobPage = await get<JobPage>(`/v1/jobs?${query.toString()}`);
    ids.push(...page.items.map(({ id }) => id));
    cursor = page.next_cursor;
  }
  return ids;
}

/** Cancels every job with the label that has not ended, also those that were not loaded. */
export async function cancelLabelled(label: string): Promise<void> {
  try {
    const ids = [...await labelled(label, 'queued'), ...await labelled(label, 'running')];
    if (ids.length > 0) await cancel(ids);
    else say(`No job with ${label} waits or runs.`);
  } catch (error) {
    say(words(error));
  }
}

/** Deletes every job with the label, with their clouds. */
export async function removeLabelled(label: string): Promise<void> {
  const yes = await confirm({
    title: `Delete all jobs with ${label}?`,
    text: 'Whether they ended or not, shown here or not: their meshes, reports and curves are erased for good, and their clouds where no other job needs them. What is held stays.',
    action: 'Delete all',
    danger: true,
  });
  if (!yes) return;
  try {
    const { jobs, clouds, held } = await (await erase(`/v1/jobs?label=${encodeURIComponent(label)}`)).json() as Erased;
    say(`${many(jobs, 'job')} and ${many(clouds, 'cloud')} deleted${held > 0 ? `; ${held} held, which stay` : ''}.`);
  } catch (error) {
    say(words(error));
  }
  await lookAgain();
}
