// Files on their way in: uploaded as soon as they are dropped, so that the form can tell what is in
// them. They survive a change of page.

import { computed, signal } from '@preact/signals';
import { upload, words } from '../api/client';
import type { Cloud } from '../api/types';

export interface Draft {
  key: number;
  name: string;
  bytes: number;
  progress: number;
  cloud: Cloud | null;
  trouble: string;
  stop: AbortController;
}

export const drafts = signal<Draft[]>([]);
export const ready = computed(() => drafts.value.filter((draft) => draft.cloud));
export const underway = computed(() => drafts.value.some((draft) => !draft.cloud && !draft.trouble));

let next = 1;
let queue = Promise.resolve();

function update(key: number, change: Partial<Draft>): void {
  drafts.value = drafts.value.map((draft) => (draft.key === key ? { ...draft, ...change } : draft));
}

/** Takes files in, one after the other: together they would only be slower. */
export function add(files: Iterable<File>): void {
  for (const file of files) {
    const draft: Draft = {
      key: next, name: file.name, bytes: file.size, progress: 0, cloud: null, trouble: '', stop: new AbortController(),
    };
    next += 1;
    drafts.value = [...drafts.value, draft];
    queue = queue.then(() => send(draft, file));
  }
}

async function send({ key, stop }: Draft, file: File): Promise<void> {
  if (stop.signal.aborted) return;
  try {
    const progress = (share: number) => update(key, { progress: share });
    update(key, { cloud: await upload<Cloud>('/v1/clouds', file, progress, stop.signal) });
  } catch (error) {
    update(key, { trouble: words(error) });
  }
}

/** Takes a cloud that is there already. */
export function reuse(cloud: Cloud, name: string): void {
  if (drafts.value.some((draft) => draft.cloud?.id === cloud.id)) return;
  const stop = new AbortController();
  drafts.value = [...drafts.value, { key: next, name, bytes: cloud.bytes, progress: 1, cloud, trouble: '', stop }];
  next += 1;
}

export function discard(draft: Draft): void {
  draft.stop.abort();
  drafts.value = drafts.value.filter(({ key }) => key !== draft.key);
}

export function clear(): void {
  drafts.value = [];
}

