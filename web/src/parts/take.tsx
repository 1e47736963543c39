// What one takes along: files, and the lines that make the same again.

import { useState } from 'preact/hooks';
import type { Job } from '../api/types';
import { differences, SETTINGS, valueOf } from './settings';
import { preset } from '../state/presets';
import { FORMATS } from '../words';
import { Copy, Panel } from './basic';

export function Downloads({ job }: { job: Job }) {
  const [first, ...others] = FORMATS;
  const link = (ending: string) => `/v1/jobs/${job.id}/mesh.${ending}`;
  return (
    <Panel title="Download">
      {first && (
        <>
          <a class="button primary" href={link(first.name)} download>Download {first.name.toUpperCase()}</a>
          <p class="help">For {first.text}.</p>
        </>
      )}
      <ul class="downloads">
        {others.map(({ name, text }) => (
          <li><a href={link(name)} download>{name.toUpperCase()}</a> {text}</li>
        ))}
        {(job.frame === 'lps' || job.frame === 'ras') && <li><a href={link('dcm')} download>DICOM</a> archives and planning, in the patient's frame</li>}
        <li><a href={`/v1/jobs/${job.id}/report`} download={`${job.id}-report.json`}>Report, as JSON</a></li>
        <li><a href={`/v1/jobs/${job.id}/metrics?format=csv`} download={`${job.id}-metrics.csv`}>Curves, as CSV</a></li>
        <li><a href={`/v1/jobs/${job.id}/model`} download>Network, as safetensors</a></li>
        <li><a href={`/v1/clouds/${job.cloud_id}/content`} download>The file as uploaded</a></li>
      </ul>
    </Panel>
  );
}

/** The request that made the job, for a cloud that is there. */
function request(job: Job) {
  const named = new Set(differences(job.settings, preset(job.preset)?.settings).map(({ name }) => name));
  const settings: Record<string, Record<string, unknown>> = {};
  for (const { group, name } of SETTINGS.filter((setting) => named.has(`${setting.group}.${setting.name}`))) {
    (settings[group] ??= {})[name] = valueOf(job.settings, group, name);
  }
  const body: Record<string, unknown> = { preset: job.preset };
  if (Object.keys(settings).length > 0) body['settings'] = settings;
  if (Object.keys(job.labels).length > 0) body['labels'] = job.labels;
  if (job.source) body['source'] = job.source;
  return body;
}

/** A text as a shell takes it. */
function quoted(text: string): string {
  return `'${text.replaceAll("'", `'\\''`)}'`;
}

function file(job: Job): string {
  return job.labels['file'] ?? 'cloud.ply';
}

function curl(job: Job): string {
  return [
    `curl -fsS ${location.origin}/v1/jobs \\`,
    `  -F ${quoted(`file=@${file(job)}`)} \\`,
    `  -F ${quoted(`job=${JSON.stringify(request(job))}`)}`,
    `curl -fsS ${location.origin}/v1/jobs/${job.id}/mesh.stl -o mesh.stl`,
  ].join('\n');
}

function python(job: Job): string {
  return [
    'import json, time, urllib.request as web',
    '',
    `url = ${JSON.stringify(location.origin)}`,
    `cloud = web.Request(url + "/v1/clouds", open(${JSON.stringify(file(job))}, "rb").read())`,
    'cloud.add_header("Content-Type", "application/octet-stream")',
    'cloud = json.load(web.urlopen(cloud))',
    `job = json.loads(${JSON.stringify(JSON.stringify(request(job)))})`,
    'job = json.dumps({"cloud_id": cloud["id"], **job}).encode()',
    'job = web.Request(url + "/v1/jobs", job, {"Content-Type": "application/json"})',
    'job = json.load(web.urlopen(job))',
    'while job["status"] in ("queued", "running"):',
    '    time.sleep(1)',
    '    job = json.load(web.urlopen(url + job["links"]["self"]))',
    'web.urlretrieve(url + job["links"]["mesh"] + ".stl", "mesh.stl")',
  ].join('\n');
}

export function Snippets({ job }: { job: Job }) {
  const [language, setLanguage] = useState<'curl' | 'Python'>('curl');
  const text = language === 'curl' ? curl(job) : python(job);
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
