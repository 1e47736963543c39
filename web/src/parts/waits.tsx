// How a job that waits stands in the queue.

import type { Row } from '../api/types';
import { until } from '../format';

/** Its place, and when it will have ended. */
export function standing({ queue_position: place, eta_seconds: seconds }: Row): string[] {
  return [...(place ? [`number ${place} in the queue`] : []), ...(seconds !== null ? [until(seconds)] : [])];
}

/** The priority of a job that waits, where it has one. */
export function Priority({ job: { status, priority } }: { job: Row }) {
  if (status !== 'queued' || !priority) return null;
  return <span class="chip">priority {priority > 0 ? '+' : '−'}{Math.abs(priority)}</span>;
}
