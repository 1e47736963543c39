// The page that is shown and its parameters stand in the address, behind the #.

import { computed, signal } from '@preact/signals';

export type PageName = 'jobs' | 'job' | 'new' | 'compare' | 'system' | 'missing';

export interface Route {
  page: PageName;
  id: string;
  query: URLSearchParams;
}

const hash = signal(location.hash);
addEventListener('hashchange', () => {
  hash.value = location.hash;
});

export const route = computed(() => parse(hash.value));

function parse(text: string): Route {
  const [path = '', search = ''] = text.replace(/^#\/?/, '').split('?');
  const [name = '', id = '', ...rest] = path.split('/');
  return { page: rest.length > 0 ? 'missing' : page(name, id), id, query: new URLSearchParams(search) };
}

function page(name: string, id: string): PageName {
  if (name === 'jobs' && id) return 'job';
  if (name === '' || (name === 'jobs' && !id)) return 'jobs';
  if ((name === 'new' || name === 'compare' || name === 'system') && !id) return name;
  return 'missing';
}

export function href(name: string, query?: Record<string, string | undefined>): string {
  const given = Object.entries(query ?? {}).filter(([, value]) => value) as [string, string][];
  const search = new URLSearchParams(given).toString();
  return `#/${name}${search ? `?${search}` : ''}`;
}

export function go(to: string): void {
  location.hash = to;
}

/** The same page with other parameters; no step in the history. */
export function replace(to: string): void {
  history.replaceState(null, '', to);
  hash.value = to;
}
