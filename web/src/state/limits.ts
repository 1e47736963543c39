// What the service allows, asked for once.

import { signal } from '@preact/signals';
import { get } from '../api/client';
import type { Limits } from '../api/types';

export const limits = signal<Limits | null>(null);

export async function loadLimits(): Promise<void> {
  limits.value ??= await get<Limits>('/v1/limits');
}
