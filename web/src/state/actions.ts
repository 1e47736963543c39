// What can be done to jobs, each with its question where it cannot be undone.

import { erase, post, words } from '../api/client';
import type { Job } from '../api/types';
import { many } from '../format';
import { confirm } from '../parts/confirm';
import { say } from '../parts/say';
import { forget } from './jobs';

/** Does it to each; how many it was done to. What went wrong is said. */
async function each(ids: string[], act: (id: string) => Promise<unknown>): Promise<number> {
  let done = 0;
  let trouble = '';
  for (const id of ids) {
    try {
      await act(id);
      done += 1;
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
