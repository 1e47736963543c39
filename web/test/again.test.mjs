// The lines that a job offers to copy ask for that very job, whatever was chosen.

import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdirSync, readFileSync, writeFileSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { before, test } from 'node:test';
import { fileURLToPath } from 'node:url';
import { build } from 'esbuild';
import { busy, folder, nifti, serve, shared } from './support.mjs';

const t = shared();
let origin;
let files;
let page;
let cloud;

/** What the page makes its lines with, here without a page. */
async function lines() {
  const absWorkingDir = dirname(dirname(fileURLToPath(import.meta.url)));
  const contents = `export * from './src/parts/snippets'; export { presets } from './src/state/presets';
    export { limits } from './src/state/limits'; export { session } from './src/state/session';`;
  const { outputFiles: [script] } = await build({
    absWorkingDir, stdin: { contents, resolveDir: absWorkingDir }, bundle: true, format: 'esm', write: false,
    jsx: 'automatic', jsxImportSource: 'preact', external: ['uplot'], define: { 'import.meta.url': '"http://here/assets/main.js"' },
  });
  Object.assign(globalThis, { location: { origin, hash: '' }, addEventListener: () => {}, setInterval: () => 0 });
  return import(`data:text/javascript;base64,${Buffer.from(script.contents).toString('base64')}`);
}

const get = async (path) => (await fetch(`${origin}${path}`)).json();
const post = (path, body) => fetch(`${origin}${path}`, {
  method: 'POST', headers: { 'content-type': 'application/json' }, body: JSON.stringify(body),
});

before(async () => {
  files = folder(t);
  origin = (await serve(t, folder(t), '127.0.0.1:0', ['--job-ttl', '30d'])).origin;
  page = await lines();
  page.presets.value = (await get('/v1/presets')).items;
  page.limits.value = await get('/v1/limits');
  page.session.value = await get('/v1/session');
  cloud = (await busy(origin, labelled(400))).cloud_id;
});

/** A ball of so many points with labels, for settings that ask for them: inside, on it and outside. */
function labelled(points) {
  const rows = Array.from({ length: points }, (_, i) => {
    const [label, radius] = [[1, 0.5], [0, 1], [-1, 1.5]][i % 3];
    const [z, turn] = [1 - (2 * i + 1) / points, 2.4 * i];
    const around = Math.sqrt(1 - z * z);
    return [around * Math.cos(turn), around * Math.sin(turn), z].map((x) => (radius * x).toFixed(6)).concat(label).join(',');
  });
  const path = join(files, 'labelled.csv');
  writeFileSync(path, `x,y,z,label\n${rows.join('\n')}\n`);
  return path;
}

/** Values that the setting may have beside the one it has, the likeliest first. */
function others({ type, options, minimum, maximum }, value) {
  if (options) return options.filter((option) => option !== value);
  if (type === 'array') return [[5, 7]];
  const near = type === 'integer' ? [value + 1, value - 1] : [value * 1.5, value / 2, value + 0.01];
  return [...near, minimum, maximum].filter((other) => other !== value && other >= minimum && other <= maximum);
}

test('each setting of a job is asked for again, and no other', async () => {
  const settings = JSON.parse(readFileSync(new URL('../src/api/settings.json', import.meta.url)));
  const preset = page.presets.value.find(({ name }) => name === 'balanced').settings;
  for (const setting of settings) {
    const { group, name } = setting;
    let job;
    for (const value of others(setting, preset[group][name])) {
      const answer = await post('/v1/jobs', { cloud_id: cloud, preset: 'balanced', settings: { [group]: { [name]: value } } });
      if (answer.status === 202) {
        job = await answer.json();
        break;
      }
    }
    assert.ok(job, `no job has another ${group}.${name}`);
    const asked = page.request(job);
    assert.deepEqual(Object.entries(asked.settings).map(([of, given]) => [of, Object.keys(given)]), [[group, [name]]]);
    const { settings: again } = await (await post('/v1/jobs?dry_run=true', { cloud_id: cloud, ...asked })).json();
    assert.deepEqual(again, job.settings);
  }
});

/** What a job is, less what is new with each. */
function asked({ preset, settings, labels, source, priority, ttl }) {
  return { preset, settings, labels, source, priority, ttl };
}

/** A job with all that can be chosen, of a file that does not say how it lies. */
async function particular(ttl) {
  const name = 'it\'s "A, B"; 5 $HOME.nii';
  const path = nifti(join(files, name), [{ label: 2, centre: [9, 9, 12], radius: 7 }], false).path;
  const { id } = await (await fetch(`${origin}/v1/clouds?assume_orientation=true`, { method: 'POST', body: readFileSync(path) })).json();
  const answer = await post('/v1/jobs', {
    cloud_id: id, preset: 'fast', settings: { surface: { resolution: 40 }, training: { snapshot_evaluations: [5, 9] } },
    labels: { file: name, who: 'O\'Brien: "x" `id` $(id) \\ ü' }, source: { label: 2 }, priority: -3, ttl,
  });
  assert.equal(answer.status, 202, await answer.clone().text());
  return { job: await answer.json(), cloud: await get(`/v1/clouds/${id}`) };
}

test('curl submits the same job', async () => {
  for (const ttl of ['download', 'never', '30d']) {
    const given = await particular(ttl);
    assert.equal(given.cloud.segmentation.assumed_orientation, true);
    const text = page.curl(given);
    // What waits for the job waits for the one before it.
    const begin = text.slice(0, text.indexOf('\ncurl'));
    const id = execFileSync('bash', ['-c', `${begin}\necho "$job"`], { cwd: files, encoding: 'utf8' }).trim();
    const again = await get(`/v1/jobs/${id}`);
    assert.deepEqual(asked(again), asked(given.job));
    assert.equal(again.cloud_id, given.job.cloud_id);
  }
});

test('Python submits the same job', async () => {
  const given = await particular('7d');
  // Tells what it is called with, in place of the client.
  const told = join(files, 'meshway_client');
  mkdirSync(told, { recursive: true });
  writeFileSync(join(told, '__init__.py'), `import json
class Meshway:
    def __init__(self, url, key=None): self.given = [url, key]
    def reconstruct(self, cloud, **asked):
        print(json.dumps([*self.given, cloud, asked]))
        return self
    def save(self, path): print(path)
`);
  const run = (env = {}) => execFileSync('python3', ['-c', page.python(given)], { cwd: files, encoding: 'utf8', env: { ...process.env, ...env } });
  const [call, saved] = run().trim().split('\n');
  const [url, key, file, { assume_orientation: assumed, ...body }] = JSON.parse(call);
  assert.deepEqual([url, key, file, assumed, saved], [origin, null, given.job.labels.file, true, 'mesh.stl']);
  const again = await (await post('/v1/jobs', { cloud_id: given.cloud.id, ...body })).json();
  assert.deepEqual(asked(again), asked(given.job));

  // Where the service knows its users, both say who asks.
  page.session.value = { name: 'anna', tenant: 'default', scopes: ['read'] };
  assert.equal(JSON.parse(run({ MESHWAY_KEY: 'mw_1' }).split('\n')[0])[1], 'mw_1');
  assert.equal(page.curl(given).match(/Authorization: Bearer \$MESHWAY_KEY/g).length, 3);
});
