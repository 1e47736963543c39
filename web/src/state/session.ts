// Who this is, and what may be done: what is not allowed is not offered.

import { signal } from '@preact/signals';
import { get } from '../api/client';
import type { Session } from '../api/types';

export type Scope = Session['scopes'][number];

export const session = signal<Session | null>(null);

export async function loadSession(): Promise<void> {
  session.value = await get<Session>('/v1/session');
}

export function may(scope: Scope): boolean {
  return session.value?.scopes.includes(scope) ?? false;
}

/** Whether the service knows its users. Without keys it cannot, and has no trail. */
export function known(): boolean {
  return (session.value?.name ?? null) !== null;
}
