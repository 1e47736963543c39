// Files on their way in: uploaded as soon as they are dropped, so that the form can tell what is in
// them. They survive a change of page.

import { computed, signal } from '@preact/signals';
import { Failure, words } from '../api/client';
import { upload } from '../api/upload';
import type { Cloud, Part } from '../api/types';

export interface Draft {
  key: number;
  name: string;
  bytes: number;
  progress: number;
  /** Why its upload waits, until it goes on by itself. */
  waits: string;
  cloud: Cloud | null;
  trouble: string;
  /** Code of the trouble, where the service gave one. */
  code: string;
  /** Numbers of the parts of a segmentation that become surfaces. */
  chosen: ReadonlySet<number>;
  /** To upload it again; null for a cloud that was there already. */
  file: File | null;
  stop: AbortController;
}

/** What one job is made of: a cloud, or a part of one. */
export interface Piece {
  draft: Draft;
  cloud: Cloud;
  part: Part | null;
}

export const drafts = signal<Draft[]>([]);
export const ready = computed(() => drafts.value.filter((draft) => draft.cloud));
export const underway = computed(() => drafts.value.some((draft) => !draft.cloud && !draft.trouble));
export const pieces = computed(() => drafts.value.flatMap(piecesOf));

/** Those of a file that have something in them. */
export function partsOf(cloud: Cloud | null): Part[] {
  return cloud?.segmentation?.items.filter(({ slices }) => slices > 0) ?? [];
}

function piecesOf(draft: Draft): Piece[] {
  const { cloud, chosen } = draft;
  if (!cloud) return [];
  if (!cloud.segmentation) return [{ draft, cloud, part: null }];
  return partsOf(cloud).filter(({ number }) => chosen.has(number)).map((part) => ({ draft, cloud, part }));
}

let next = 1;
let queue = Promise.resolve();

function begun(name: string, bytes: number, file: File | null): Draft {
  const draft: Draft = {
    key: next, name, bytes, progress: 0, waits: '', cloud: null, trouble: '', code: '', chosen: new Set(), file,
    stop: new AbortController(),
  };
  next += 1;
  return draft;
}

function update(key: number, change: Partial<Draft>): void {
  drafts.value = drafts.value.map((draft) => (draft.key === key ? { ...draft, ...change } : draft));
}

/** What a cloud adds to its draft: the only part of a file is chosen. */
function found(cloud: Cloud): Partial<Draft> {
  const parts = partsOf(cloud);
  return { cloud, progress: 1, chosen: new Set(parts.length === 1 ? parts.map(({ number }) => number) : []) };
}

/** Takes files in, one after the other: together they would only be slower. */
export function add(files: Iterable<File>): void {
  for (const file of files) {
    const draft = begun(file.name, file.size, file);
    drafts.value = [...drafts.value, draft];
    queue = queue.then(() => send(draft, file, false));
  }
}

/** Uploads a file again that does not say how it lies in the patient: it is taken as it lies. */
export function assume({ key }: Draft): void {
  update(key, { trouble: '', code: '', progress: 0 });
  const draft = drafts.value.find((other) => other.key === key);
  const file = draft?.file;
  if (draft && file) queue = queue.then(() => send(draft, file, true));
}

async function send({ key, stop }: Draft, file: File, assumed: boolean): Promise<void> {
  if (stop.signal.aborted) return;
  try {
    const cloud = await upload(file, {
      assumed,
      signal: stop.signal,
      onProgress: (share) => update(key, { progress: share, waits: '' }),
      onWait: (why) => update(key, { waits: why }),
    });
    update(key, { ...found(cloud), waits: '' });
  } catch (error) {
    update(key, { waits: '', trouble: words(error), code: error instanceof Failure ? error.problem?.code ?? '' : '' });
  }
}

/** Takes a cloud that is there already. */
export function reuse(cloud: Cloud, name: string): void {
  if (drafts.value.some((draft) => draft.cloud?.id === cloud.id)) return;
  drafts.value = [...drafts.value, { ...begun(name, cloud.bytes, null), ...found(cloud) }];
}

/** Chooses the parts that become surfaces. */
export function choose({ key }: Draft, chosen: ReadonlySet<number>): void {
  update(key, { chosen });
}

export function discard(draft: Draft): void {
  draft.stop.abort();
  drafts.value = drafts.value.filter(({ key }) => key !== draft.key);
}

/** Takes out what there are jobs of now. */
export function finish(done: Piece[]): void {
  for (const { draft: { key }, part } of done) {
    const draft = drafts.value.find((other) => other.key === key);
    if (!draft) continue;
    const left = new Set([...draft.chosen].filter((number) => number !== part?.number));
    if (left.size > 0) choose(draft, left);
    else discard(draft);
  }
}
