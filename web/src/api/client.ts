// Requests to the service. Whatever goes wrong is a `Failure` with a sentence for people.

import { signal } from '@preact/signals';
import type { Problem } from './types';

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
    response = await fetch(path, init);
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

export async function post<T>(path: string, body?: unknown, signal?: AbortSignal): Promise<T> {
  const init: RequestInit = { method: 'POST', signal: signal ?? null };
  if (body !== undefined) {
    init.headers = { 'content-type': 'application/json' };
    init.body = JSON.stringify(body);
  }
  return (await answer(path, init)).json() as Promise<T>;
}

export async function erase(path: string): Promise<void> {
  await answer(path, { method: 'DELETE' });
}

/** Uploads a file; fetch does not tell how far it is. */
export function upload<T>(path: string, file: File, onProgress: (share: number) => void, signal: AbortSignal): Promise<T> {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open('POST', path);
    request.upload.onprogress = ({ loaded, total }) => onProgress(total > 0 ? loaded / total : 0);
    request.onerror = () => reject(unreachable());
    request.onload = () => {
      if (request.status < 300) resolve(JSON.parse(request.responseText) as T);
      else reject(failure(request.status, request.responseText));
    };
    // Who waits for it goes on.
    request.onabort = () => reject(new DOMException('The upload was given up.', 'AbortError'));
    signal.addEventListener('abort', () => request.abort());
    const form = new FormData();
    form.append('file', file);
    request.send(form);
  });
}

/** The words of an error for people. */
export function words(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
