// What every test in a browser needs: a service over a folder of its own, a browser, and pages that
// tell everything that should not have happened.

import { execFileSync, spawn } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { dirname, join } from 'node:path';
import { after } from 'node:test';
import { fileURLToPath } from 'node:url';
import { chromium } from 'playwright-core';

export const root = dirname(dirname(dirname(fileURLToPath(import.meta.url))));
export const program = process.env.MESHWAY ?? join(root, 'target/release/meshway');
const axe = readFileSync(createRequire(import.meta.url).resolve('axe-core/axe.min.js'), 'utf8');

/** Longest wait for anything, in milliseconds: a job of the fast preset on a slow machine. */
const PATIENCE = 60_000;

/** What a file of tests shares; it is tidied up, the last first, when all of them are over. */
export function shared() {
  const tidying = [];
  after(async () => {
    for (const tidy of tidying.reverse()) await tidy();
  });
  return { after: (tidy) => tidying.push(tidy) };
}

/** A folder that is gone when the test is over. */
export function folder(t) {
  const path = mkdtempSync(join(tmpdir(), 'meshway-web-'));
  t.after(() => rmSync(path, { recursive: true, force: true }));
  return path;
}

/** Starts the service and waits until it says where it listens. */
export async function serve(t, data, listen = '127.0.0.1:0', more = []) {
  const flags = ['serve', '--listen', listen, '--data-dir', data, '--disk-reserve-mib', '1', '--disk-reserve-percent', '0', ...more];
  const child = spawn(program, flags, { stdio: ['ignore', 'pipe', 'pipe'] });
  const ended = new Promise((resolve) => { child.once('exit', resolve); });
  let log = '';
  const origin = await new Promise((resolve, reject) => {
    const hear = (chunk) => {
      log += chunk;
      const found = log.match(/http:\/\/127\.0\.0\.1:\d+/);
      if (found) resolve(found[0]);
    };
    child.stdout.on('data', hear);
    child.stderr.on('data', hear);
    void ended.then(() => reject(new Error(`the service did not start: ${log}`)));
  });
  const stop = async (signal = 'SIGTERM') => {
    child.kill(signal);
    await ended;
  };
  t.after(() => stop('SIGKILL'));
  return { origin, stop };
}

/** A cloud of so many points. */
export function sample(at, shape, points, name = `${shape}.ply`) {
  const path = join(at, name);
  execFileSync(program, ['sample', shape, '--points', String(points), '--seed', '1', '--output', path], { stdio: 'ignore' });
  return path;
}

/** Voxels along an edge. */
export const EDGE = 24;

/** A NIfTI-1 label map of balls, with or without its place in the patient. */
export function nifti(path, balls, placed = true) {
  const head = Buffer.alloc(352);
  head.writeInt32LE(348, 0);
  [3, EDGE, EDGE, EDGE, 1, 1, 1, 1].forEach((size, i) => head.writeInt16LE(size, 40 + 2 * i));
  head.writeInt16LE(2, 70); // Unsigned bytes,
  head.writeInt16LE(8, 72); // of eight bits.
  for (let i = 0; i < 8; i += 1) head.writeFloatLE(1, 76 + 4 * i);
  head.writeFloatLE(352, 108);
  head.writeFloatLE(1, 112);
  head.writeUInt8(2, 123); // Millimetres.
  head.writeInt16LE(placed ? 1 : 0, 254);
  for (let row = 0; placed && row < 3; row += 1) head.writeFloatLE(1, 280 + 16 * row + 4 * row);
  head.write('n+1\0', 344, 'latin1');
  const voxels = Buffer.alloc(EDGE ** 3);
  for (let i = 0; i < voxels.length; i += 1) {
    const at = [i % EDGE, Math.floor(i / EDGE) % EDGE, Math.floor(i / EDGE ** 2)];
    const ball = balls.find(({ centre, radius }) => Math.hypot(...at.map((x, axis) => x - centre[axis])) < radius);
    voxels[i] = ball?.label ?? 0;
  }
  writeFileSync(path, Buffer.concat([head, voxels]));
  return { path, voxels: (label) => voxels.filter((value) => value === label).length };
}

/** Submits a job without the page. */
export async function submit(origin, path, job) {
  const form = new FormData();
  form.append('file', new Blob([readFileSync(path)]), 'cloud.ply');
  form.append('job', JSON.stringify(job));
  const response = await fetch(`${origin}/v1/jobs`, { method: 'POST', body: form });
  if (response.status !== 202) throw new Error(await response.text());
  return response.json();
}

/** The job once it is no longer in any of these states. */
async function past(origin, id, states) {
  for (;;) {
    const job = await (await fetch(`${origin}/v1/jobs/${id}`)).json();
    if (!states.includes(job.status)) return job;
    await new Promise((resolve) => { setTimeout(resolve, 200); });
  }
}

export const ended = (origin, id) => past(origin, id, ['queued', 'running']);

/** A job that keeps the only worker busy until it is cancelled or erased: Adam on one network never ends by itself. */
export async function busy(origin, path, labels = {}) {
  const training = { optimizer: 'adam', max_evaluations: 1_000_000, patience: 0 };
  const job = await submit(origin, path, { preset: 'fine', settings: { training, network: { block_points: 0 } }, labels });
  return past(origin, job.id, ['queued']);
}

export async function browse(t) {
  const executablePath = ['/usr/bin/chromium', '/usr/bin/chromium-headless-shell'].find(existsSync);
  // Nothing but the service's own pages is loaded, and CI runs as root, where there is no sandbox.
  const args = ['--no-sandbox', '--enable-unsafe-swiftshader', '--use-angle=swiftshader'];
  const browser = await chromium.launch({ executablePath, args });
  t.after(() => browser.close());
  return browser;
}

/** A page, and what went wrong in it so far: errors of the console, requests to elsewhere. */
export async function open(browser, origin, options = {}) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 800 }, reducedMotion: 'reduce', ...options });
  const page = await context.newPage();
  page.setDefaultTimeout(PATIENCE);
  const faults = [];
  page.on('console', (message) => { if (message.type() === 'error') faults.push(message.text()); });
  page.on('pageerror', (error) => faults.push(error.message));
  page.on('request', (request) => {
    if (!request.url().startsWith(`${origin}/`) && !/^(blob|data):/.test(request.url())) faults.push(`left for ${request.url()}`);
  });
  return { page, faults };
}

/** Drops a file onto the page as a user does. */
export async function drop(page, path, name) {
  const content = readFileSync(path).toString('base64');
  const dataTransfer = await page.evaluateHandle(([text, fileName]) => {
    const transfer = new DataTransfer();
    transfer.items.add(new File([Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0))], fileName));
    return transfer;
  }, [content, name]);
  for (const type of ['dragenter', 'dragover', 'drop']) await page.dispatchEvent('main', type, { dataTransfer });
}

/** What axe finds against WCAG 2.2 AA, in a line each. */
export async function violations(page) {
  await page.evaluate(axe);
  const { violations: found } = await page.evaluate(() => window.axe.run(document, {
    runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa'],
  }));
  return found.flatMap(({ id, help, nodes }) => nodes.map(({ html }) => `${id}: ${help}: ${html}`));
}

/** Number of different colours of a picture, as far as a sample of it shows. */
export function colours(page, png) {
  return page.evaluate(async (text) => {
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    const picture = await createImageBitmap(new Blob([bytes], { type: 'image/png' }));
    const canvas = new OffscreenCanvas(picture.width, picture.height);
    const context = canvas.getContext('2d');
    context.drawImage(picture, 0, 0);
    const { data } = context.getImageData(0, 0, picture.width, picture.height);
    const seen = new Set();
    for (let at = 0; at < data.length; at += 4 * 7) seen.add((data[at] << 16) | (data[at + 1] << 8) | data[at + 2]);
    return seen.size;
  }, png.toString('base64'));
}
