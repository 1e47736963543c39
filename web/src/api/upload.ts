// Uploads: small files in one request, large ones in parts, by tus 1.0, that go on where they were cut.

import { answer, erase, Failure, get, send } from './client';
import type { Cloud } from './types';

/** Files above this go in parts. */
const LARGE = 16 * 1024 * 1024;

/** Bytes of a part: little is sent twice, and there are few requests. */
const PART = 8 * 1024 * 1024;

/** Milliseconds before the first and the longest wait for a service that is away. */
const PAUSE = 500;
const LONGEST_PAUSE = 10_000;

const TUS = { 'Tus-Resumable': '1.0.0' };

/** How an upload is to be done, and who is told of it. */
export interface Course {
  /** Whether a file that does not say how it lies in the patient is taken as it lies. */
  assumed: boolean;
  signal: AbortSignal;
  onProgress: (share: number) => void;
  /** Told why it does not go on at present. */
  onWait: (why: string) => void;
}

export function upload(file: File, course: Course): Promise<Cloud> {
  return file.size > LARGE ? inParts(file, course) : atOnce(file, course);
}

const wish = (assumed: boolean) => (assumed ? '?assume_orientation=true' : '');

async function atOnce(file: File, { assumed, signal, onProgress }: Course): Promise<Cloud> {
  const body = new FormData();
  body.append('file', file);
  const request = await send({
    method: 'POST', path: `/v1/clouds${wish(assumed)}`, body, signal,
    onProgress: (loaded, total) => onProgress(total > 0 ? loaded / total : 0),
  });
  return JSON.parse(request.responseText) as Cloud;
}

async function inParts(file: File, course: Course): Promise<Cloud> {
  const address = await patiently(course, () => begin(file, course));
  let at: number | null = 0;
  try {
    for (;;) {
      const step = await patiently(course, () => {
        const from = at;
        // After anything that goes wrong the service is asked how far it is.
        at = null;
        return append(file, course, { address, from });
      });
      if (typeof step !== 'number') return step;
      at = step;
    }
  } catch (error) {
    // Nobody goes on with it. What the service cannot erase now it erases when its time is over.
    await erase(address).catch(() => undefined);
    throw error;
  }
}

async function begin(file: File, { assumed, signal }: Course): Promise<string> {
  const name = btoa(String.fromCharCode(...new TextEncoder().encode(file.name)));
  const headers = { ...TUS, 'Upload-Length': String(file.size), 'Upload-Metadata': `filename ${name}` };
  const response = await answer(`/v1/uploads${wish(assumed)}`, { method: 'POST', headers, signal });
  return response.headers.get('location') ?? '';
}

/** Sends the next part; the offset behind it, or what came of the whole. */
async function append(file: File, { signal, onProgress }: Course, { address, from }: Place): Promise<number | Cloud> {
  const at = from ?? await offset(address, signal);
  const request = await send({
    method: 'PATCH', path: address, signal,
    headers: { ...TUS, 'Upload-Offset': String(at), 'Content-Type': 'application/offset+octet-stream' },
    body: file.slice(at, at + PART),
    onProgress: (loaded) => onProgress((at + loaded) / file.size),
  });
  const cloud = /<([^>]*\/v1\/clouds\/[^>]+)>/.exec(request.getResponseHeader('link') ?? '')?.[1];
  return cloud ? get<Cloud>(cloud, signal) : Number(request.getResponseHeader('upload-offset'));
}

/** An upload, and how far it is where that is known. */
interface Place {
  address: string;
  from: number | null;
}

async function offset(address: string, signal: AbortSignal): Promise<number> {
  const response = await answer(address, { method: 'HEAD', headers: TUS, signal });
  return Number(response.headers.get('upload-offset'));
}

/** Whether the same can succeed later: nobody answered, or the service says so. */
function passes(error: unknown): error is Failure {
  if (!(error instanceof Failure)) return false;
  return error.problem ? error.problem.retryable : error.status === 0 || error.status === 409 || error.status >= 500;
}

/** Does it until it succeeds or cannot, with longer and longer pauses. */
async function patiently<T>({ signal, onWait }: Course, act: () => Promise<T>): Promise<T> {
  for (let pause = PAUSE; ; pause = Math.min(2 * pause, LONGEST_PAUSE)) {
    try {
      return await act();
    } catch (error) {
      if (!passes(error)) throw error;
      onWait(error.message);
      await quiet(pause, signal);
    }
  }
}

/** Some time without doing anything; less where the network comes back or it is given up. */
function quiet(milliseconds: number, signal: AbortSignal): Promise<void> {
  return new Promise((resolve) => {
    const over = () => {
      clearTimeout(timer);
      removeEventListener('online', over);
      signal.removeEventListener('abort', over);
      resolve();
    };
    const timer = setTimeout(over, milliseconds);
    addEventListener('online', over);
    signal.addEventListener('abort', over);
  });
}
