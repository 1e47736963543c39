// The lines that make the same job again, for curl and for Python.

import { useState } from 'preact/hooks';
import { at } from '../api/client';
import type { Cloud, Job, NewJob } from '../api/types';
import { limits } from '../state/limits';
import { preset } from '../state/presets';
import { known } from '../state/session';
import { Copy, Panel } from './basic';
import { differences, SETTINGS, valueOf } from './settings';

export interface Again {
  job: Job;
  /** Null where it was erased, or is not there yet. */
  cloud: Cloud | null;
}

/** What the job was asked for, beyond its cloud. */
export function request(job: Job): NewJob {
  const named = new Set(differences(job.settings, preset(job.preset)?.settings).map(({ name }) => name));
  const settings: Record<string, Record<string, unknown>> = {};
  for (const { group, name } of SETTINGS.filter((setting) => named.has(`${setting.group}.${setting.name}`))) {
    (settings[group] ??= {})[name] = valueOf(job.settings, group, name);
  }
  const body: NewJob = { preset: job.preset };
  if (Object.keys(settings).length > 0) body.settings = settings as NonNullable<NewJob['settings']>;
  if (Object.keys(job.labels).length > 0) body.labels = job.labels;
  if (job.source) body.source = job.source;
  if (job.priority) body.priority = job.priority;
  const ttl = job.ttl ?? 'never';
  if (ttl !== (limits.value?.job_ttl ?? 'never')) body.ttl = ttl;
  return body;
}

/** A text as a shell takes it. */
function quoted(text: string): string {
  return `'${text.replaceAll("'", `'\\''`)}'`;
}

/** The name of a file in a form of curl, which takes marks of its own. */
function attached(name: string): string {
  return /[";,\\]/.test(name) ? `"${name.replace(/["\\]/g, '\\$&')}"` : name;
}

const file = (job: Job) => job.labels['file'] ?? 'cloud.ply';
const assumed = (cloud: Cloud | null) => cloud?.segmentation?.assumed_orientation === true;

export function curl({ job, cloud }: Again): string {
  const who = known() ? ' -H "Authorization: Bearer $MESHWAY_KEY"' : '';
  const jobs = `${location.origin}${at('/v1/jobs')}`;
  return [
    `job=$(curl -fsS${who} ${quoted(`${jobs}${assumed(cloud) ? '?assume_orientation=true' : ''}`)} \\`,
    `  -F ${quoted(`file=@${attached(file(job))}`)} \\`,
    `  --form-string ${quoted(`job=${JSON.stringify(request(job))}`)} | grep -o 'job_[0-9a-f]*' | head -n 1)`,
    `curl -fsSN${who} ${jobs}/$job/events   # until it has ended`,
    `curl -fsS${who} ${jobs}/$job/mesh.stl -o mesh.stl`,
  ].join('\n');
}

/** A value as Python writes it. */
function literal(value: unknown): string {
  if (value === null || value === undefined) return 'None';
  if (typeof value === 'boolean') return value ? 'True' : 'False';
  if (Array.isArray(value)) return `[${value.map(literal).join(', ')}]`;
  if (typeof value === 'object') return `{${Object.entries(value).map(([name, item]) => `${JSON.stringify(name)}: ${literal(item)}`).join(', ')}}`;
  return JSON.stringify(value);
}

export function python({ job, cloud }: Again): string {
  const given: [string, unknown][] = Object.entries(request(job));
  if (assumed(cloud)) given.push(['assume_orientation', true]);
  const who = known() ? ', os.environ["MESHWAY_KEY"]' : '';
  return [
    '# pip install ./clients/python',
    ...(known() ? ['import os', ''] : []),
    'from meshway_client import Meshway',
    '',
    `service = Meshway(${JSON.stringify(`${location.origin}${at('')}`)}${who})`,
    'mesh = service.reconstruct(',
    `    ${JSON.stringify(file(job))},`,
    ...given.map(([name, value]) => `    ${name}=${literal(value)},`),
    ')',
    'mesh.save("mesh.stl")',
  ].join('\n');
}

const LANGUAGES = { curl, Python: python };

export function Snippets(again: Again) {
  const [language, setLanguage] = useState<keyof typeof LANGUAGES>('curl');
  const text = LANGUAGES[language](again);
  return (
    <Panel title="The same again" aside={<Copy text={text} label={`the lines for ${language}`} />}>
      <div class="buttons" role="group" aria-label="Language">
        {(['curl', 'Python'] as const).map((name) => (
          <button type="button" class="small" aria-pressed={name === language} onClick={() => setLanguage(name)}>{name}</button>
        ))}
      </div>
      <pre tabIndex={0} aria-label={`Lines for ${language}`}><code>{text}</code></pre>
    </Panel>
  );
}
