// One line that says what was done, read out by screen readers.

import { signal } from '@preact/signals';

const said = signal('');
let timer = 0;

export function say(text: string): void {
  said.value = text;
  clearTimeout(timer);
  timer = setTimeout(() => {
    said.value = '';
  }, 6000);
}

export function Said() {
  return <div class={said.value ? 'said' : 'hidden'} role="status">{said.value}</div>;
}
