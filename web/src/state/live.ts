// The one stream of events that all of the page lives from. Its state is shown; a stream that broke
// comes back by itself, and whoever listens is told to look again at what it may have missed.

import { signal } from '@preact/signals';
import { at, unknown } from '../api/client';
import { loadSession } from './session';

export type Connection = 'connecting' | 'live' | 'lost';

export const connection = signal<Connection>('connecting');

export interface LiveEvent {
  name: string;
  data: { job_id: string; time: string; attempt: number } & Record<string, unknown>;
}

const NAMES = ['job.queued', 'job.started', 'job.attempt_started', 'job.phase', 'job.progress',
  'training.metrics', 'job.snapshot', 'job.warning', 'job.succeeded', 'job.failed', 'job.cancelled'];

/** Seconds until a refused stream is asked for again. */
const PAUSE = 2;

const listeners = new Set<(event: LiveEvent) => void>();
const returns = new Set<() => void>();

/** Calls back for each event until the answer is called. */
export function onEvent(listener: (event: LiveEvent) => void): () => void {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

/** Calls back each time the stream begins: events may have been missed before. */
export function onReturn(listener: () => void): () => void {
  returns.add(listener);
  return () => returns.delete(listener);
}

export function connect(): void {
  // The page is loaded anew after signing in.
  if (unknown.value) return;
  const source = new EventSource(at('/v1/events'));
  source.onopen = () => {
    connection.value = 'live';
    returns.forEach((listener) => listener());
  };
  source.onerror = () => {
    connection.value = 'lost';
    // The browser comes back by itself after a broken connection, not after a refusal.
    if (source.readyState === EventSource.CLOSED) {
      // Where the session has ended, that leads to the form.
      void loadSession().catch(() => undefined);
      again(source);
    }
  };
  // The service stops, or does not know the last id any more.
  for (const name of ['shutdown', 'reset']) {
    source.addEventListener(name, () => {
      connection.value = 'lost';
      again(source);
    });
  }
  for (const name of NAMES) {
    source.addEventListener(name, (message) => {
      const data = JSON.parse((message as MessageEvent<string>).data) as LiveEvent['data'];
      listeners.forEach((listener) => listener({ name, data }));
    });
  }
}

function again(source: EventSource): void {
  source.close();
  setTimeout(connect, PAUSE * 1000);
}
