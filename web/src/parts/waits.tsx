// How a job that waits stands in the queue.

import type { Row } from '../api/types';
import { until } from '../format';

/** Its place, when it will have ended, and its priority where it has one. */
export function standing({ queue_position: place, eta_seconds: seconds, priority }: Row): string[] {
  return [
    ...(place ? [`number ${place} in the queue`] : []),
    ...(seconds !== null ? [until(seconds)] : []),
    ...(priority ? [`priority ${priority > 0 ? '+' : '−'}${Math.abs(priority)}`] : []),
  ];
}
