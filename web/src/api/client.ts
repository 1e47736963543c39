// Requests to the service. Whatever goes wrong is a `Failure` with a sentence for people.

import { signal } from '@preact/signals';
import type { Problem } from './types';

/** Path below which a proxy offers the service: scripts are loaded from assets/ below it. */
const base = new URL('..', import.meta.url).pathname.slice(0, -1);

/** The address of a path of the service; those that the service gives begin with the base already. */
export function at(path: string): string {
  return base && path.startsWith(`${base}/`) ? path : `${base}${path}`;
}

/** Whether the service asked who this is: it has keys, and this browser has none that it knows. */
export const unknown = signal(false);

/** An answer that is no success, or none at all. */
export class Failure extends Error {
  constructor(message: string, readonly status: number, readonly problem: Problem | null) {
    super(message);
  }

  /** What is wrong, by JSON pointer. */
  get faults(): Map<string, string> {
    return new Map((this.problem?.errors ?? []).map(({ pointer, detail }) => [pointer, detail]));
  }
}

function failure(status: number, body: string): Failure {
  if (status === 401) unknown.value = true;
  try {
    const problem = JSON.parse(body) as Problem;
    const many = problem.errors.length > 1;
    return new Failure(many ? problem.title : sentence(problem.detail), status, problem);
  } catch {
    return new Failure(`The service answered with ${status}.`, status, null);
  }
}

function unreachable(): Failure {
  return new Failure('The service cannot be reached.', 0, null);
}

/** A detail of the API with a capital and a full stop. */
export function sentence(text: string): string {
  const trimmed = text.trim();
  const end = /[.!?]$/.test(trimmed) ? '' : '.';
  return trimmed.charAt(0).toUpperCase() + trimmed.slice(1) + end;
}

export async function answer(path: string, init?: RequestInit): Promise<Response> {
  let response: Response;
  try {
    response = await fetch(at(path), init);
  } catch (error) {
    if (error instanceof DOMException && error.name === 'AbortError') throw error;
    throw unreachable();
  }
  if (!response.ok) throw failure(response.status, await response.text());
  return response;
}

export async function get<T>(path: string, signal?: AbortSignal): Promise<T> {
  return (await answer(path, { signal: signal ?? null })).json() as Promise<T>;
}

/** A request with a body of JSON, if with any. */
function sending(method: string, body: unknown, signal?: AbortSignal): RequestInit {
  const init: RequestInit = { method, signal: signal ?? null };
  if (body !== undefined) {
    init.headers = { 'content-type': 'application/json' };
    init.body = JSON.stringify(body);
  }
  return init;
}

export async function post<T>(path: string, body?: unknown, signal?: AbortSignal): Promise<T> {
  return (await answer(path, sending('POST', body, signal))).json() as Promise<T>;
}

export async function patch<T>(path: string, body: unknown): Promise<T> {
  return (await answer(path, sending('PATCH', body))).json() as Promise<T>;
}

export function erase(path: string): Promise<Response> {
  return answer(path, { method: 'DELETE' });
}

/** A request with a body whose way is told of. */
export interface Sending {
  method: 'POST' | 'PATCH';
  path: string;
  headers?: Record<string, string>;
  body: FormData | Blob;
  /** Bytes of the body that left so far, and all of them. */
  onProgress: (loaded: number, total: number) => void;
  signal: AbortSignal;
}

/** Sends it; fetch does not tell how far it is. */
export function send({ method, path, headers, body, onProgress, signal }: Sending): Promise<XMLHttpRequest> {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open(method, at(path));
    for (const [name, value] of Object.entries(headers ?? {})) request.setRequestHeader(name, value);
    request.upload.onprogress = ({ loaded, total }) => onProgress(loaded, total);
    request.onerror = () => reject(unreachable());
    // Who waits for it goes on.
    request.onabort = () => reject(new DOMException('The upload was given up.', 'AbortError'));
    request.onload = () => {
      if (request.status < 300) resolve(request);
      else reject(failure(request.status, request.responseText));
    };
    const stop = () => request.abort();
    request.onloadend = () => signal.removeEventListener('abort', stop);
    signal.addEventListener('abort', stop);
    request.send(body);
  });
}

/** The words of an error for people. */
export function words(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
