// The presets, asked for once.

import { signal } from '@preact/signals';
import { get } from '../api/client';
import type { PresetEntry } from '../api/types';

export const presets = signal<PresetEntry[]>([]);

export async function loadPresets(): Promise<void> {
  if (presets.value.length === 0) presets.value = (await get<{ items: PresetEntry[] }>('/v1/presets')).items;
}

export function preset(name: string): PresetEntry | undefined {
  return presets.value.find((entry) => entry.name === name);
}
