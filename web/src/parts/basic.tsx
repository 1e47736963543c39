// Small parts that every page uses.

import type { ComponentChildren } from 'preact';
import { useState } from 'preact/hooks';
import type { Row, Status, Verdict } from '../api/types';
import { local, soon } from '../format';
import { STATUS, VERDICT } from '../words';

const MARKS: Record<Status | Verdict, string> = {
  queued: '◷', running: '▶', succeeded: '✓', failed: '✕', cancelled: '–', good: '✓', doubtful: '?', poor: '!',
};

/** A state in a word, a mark and a colour: never by colour alone. */
export function Badge({ of }: { of: Status | Verdict }) {
  const text = of in STATUS ? STATUS[of as Status] : VERDICT[of as Verdict];
  return <span class={`badge ${of}`}><span aria-hidden="true">{MARKS[of]}</span> {text}</span>;
}

/** A local time, shorter where there is little room; in UTC on hover. */
export function Time({ at, brief }: { at: string; brief?: boolean }) {
  return <time dateTime={at} title={`${at.replace('T', ' ').slice(0, 19)} UTC`}>{brief ? soon(at) : local(at)}</time>;
}

export function Progress({ share, label }: { share: number; label: string }) {
  return <progress max={1} value={share} aria-label={label} />;
}

/** What a job is called: by the file and the part of it that it was made from, where that is known. */
export function title({ id, labels: { file, part }, source }: Pick<Row, 'id' | 'labels' | 'source'>): string {
  if (!file) return `Job ${short(id)}`;
  const of = source && (part ?? String(source.label ?? source.segment ?? source.roi));
  return of ? `${file}, ${of}` : file;
}

/** The end of an id tells jobs apart, its beginning is the time. */
export function short(id: string): string {
  return id.slice(-8);
}

/** How long a job is kept, where that is not for ever. */
export function Kept({ job: { hold, expires_at: end } }: { job: Pick<Row, 'hold' | 'expires_at'> }) {
  if (hold) return <span class="kept" title="It cannot be erased until it is let go.">Held</span>;
  return end ? <span class="kept">Erased <Time at={end} brief /></span> : null;
}

export function Trouble({ children }: { children: ComponentChildren }) {
  return <p class="trouble" role="alert">{children}</p>;
}

export function Copy({ text, label }: { text: string; label: string }) {
  const [copied, setCopied] = useState(false);
  const copy = async () => {
    await navigator.clipboard.writeText(text);
    setCopied(true);
    setTimeout(() => setCopied(false), 2000);
  };
  return (
    <button type="button" class="small" aria-label={`Copy ${label}`} onClick={() => void copy()}>
      <span role="status">{copied ? 'Copied' : 'Copy'}</span>
    </button>
  );
}

export function Panel({ title: heading, children, aside }: {
  title: string; children: ComponentChildren; aside?: ComponentChildren;
}) {
  const id = `panel-${heading.toLowerCase().replace(/\W+/g, '-')}`;
  return (
    <section class="panel" aria-labelledby={id}>
      <div class="panel-head"><h2 id={id}>{heading}</h2>{aside}</div>
      {children}
    </section>
  );
}
