// A large file goes in parts, and goes on where it was cut.

import assert from 'node:assert/strict';
import { createHash } from 'node:crypto';
import { readFileSync, writeFileSync } from 'node:fs';
import { connect, createServer } from 'node:net';
import { join } from 'node:path';
import { before, test } from 'node:test';
import { browse, folder, open, serve, shared, violations } from './support.mjs';

const t = shared();
let origin;
let browser;

before(async () => {
  origin = (await serve(t, folder(t))).origin;
  browser = await browse(t);
});

/** More bytes than the requests have beside the file. */
const BESIDE = 2 ** 20;

/** The way to the service, which can be cut: then it is gone until it is mended. */
async function way(to) {
  const { port } = new URL(to);
  const state = { cutAfter: Infinity, cut: false, brought: 0 };
  const sockets = new Set();
  const server = createServer((near) => {
    if (state.cut) {
      near.destroy();
      return;
    }
    const far = connect(Number(port), '127.0.0.1');
    for (const [socket, other] of [[near, far], [far, near]]) {
      sockets.add(socket);
      socket.on('error', () => {});
      socket.on('close', () => {
        sockets.delete(socket);
        other.destroy();
      });
    }
    far.pipe(near);
    near.on('data', (chunk) => {
      state.brought += chunk.length;
      if (state.brought > state.cutAfter) {
        state.cut = true;
        sockets.forEach((socket) => socket.destroy());
      } else if (!far.write(chunk)) near.pause();
    });
    far.on('drain', () => near.resume());
  });
  await new Promise((resolve) => { server.listen(0, '127.0.0.1', resolve); });
  t.after(() => {
    sockets.forEach((socket) => socket.destroy());
    server.close();
  });
  state.origin = `http://127.0.0.1:${server.address().port}`;
  return state;
}

/** Points of a sphere, each with so many numbers beside it that the file is large. */
function large(path) {
  const [points, others] = [30_000, 80];
  const names = Array.from({ length: others }, (_, i) => `property double extra${i}\n`).join('');
  const head = `ply\nformat binary_little_endian 1.0\nelement vertex ${points}\nproperty double x\nproperty double y\nproperty double z\n${names}end_header\n`;
  const body = Buffer.alloc(points * 8 * (3 + others));
  for (let i = 0; i < points; i += 1) {
    const z = 1 - (2 * i + 1) / points;
    const angle = i * 2.399963;
    const r = Math.sqrt(1 - z * z);
    [r * Math.cos(angle), r * Math.sin(angle), z].forEach((x, axis) => body.writeDoubleLE(x, 8 * (axis + i * (3 + others))));
  }
  writeFileSync(path, Buffer.concat([Buffer.from(head), body]));
  return path;
}

test('an upload that is cut in the middle goes on from there', async () => {
  const path = large(join(folder(t), 'large.ply'));
  const content = readFileSync(path);
  assert.ok(content.length > 16 * 2 ** 20);
  const through = await way(origin);
  const { page, faults } = await open(browser, through.origin);
  const asked = [];
  page.on('request', (request) => {
    if (request.url().includes('/v1/uploads')) asked.push(`${request.method()} ${request.headers()['upload-offset'] ?? ''}`.trim());
  });
  await page.goto(`${through.origin}/#/new`);
  await page.getByRole('heading', { name: 'Files' }).waitFor();
  // In the second part.
  through.cutAfter = through.brought + 11 * 2 ** 20;
  await page.locator('input[type=file]').first().setInputFiles(path);
  await page.getByText('The upload goes on by itself from where it was cut.').waitFor();
  assert.ok(through.cut);
  assert.deepEqual(await violations(page), []);
  await page.getByRole('progressbar', { name: 'Upload of large.ply' }).waitFor();
  const before = through.brought;
  through.cutAfter = Infinity;
  through.cut = false;
  await page.getByText('30,000 points').waitFor();
  await page.getByText('The upload goes on by itself').waitFor({ state: 'hidden' });

  // It was begun once, and the first part was not sent again.
  assert.equal(asked.filter((request) => request === 'POST').length, 1, asked.join(', '));
  assert.ok(asked.includes('HEAD'), asked.join(', '));
  const again = through.brought - before;
  assert.ok(again < content.length - 8 * 2 ** 20 + BESIDE, `${again} bytes after the cut`);
  const { items } = await (await fetch(`${origin}/v1/clouds`)).json();
  assert.deepEqual(items.map(({ sha256 }) => sha256), [createHash('sha256').update(content).digest('hex')]);
  // The browser notes what it could not reach; nothing else went wrong.
  assert.deepEqual(faults.filter((fault) => !/ERR_CONNECTION|ERR_EMPTY_RESPONSE|ERR_INCOMPLETE|ERR_SOCKET|ERR_NETWORK/.test(fault)), []);
  await page.context().close();
});

test('an upload that is taken back is erased, and those behind it come in', async () => {
  const files = folder(t);
  const path = large(join(files, 'other.ply'));
  const through = await way(origin);
  const { page } = await open(browser, through.origin);
  await page.goto(`${through.origin}/#/new`);
  await page.getByRole('heading', { name: 'Files' }).waitFor();
  const begun = page.waitForResponse((response) => response.url().endsWith('/v1/uploads') && response.status() === 201);
  through.cutAfter = through.brought + 9 * 2 ** 20;
  const small = join(files, 'small.xyz');
  writeFileSync(small, Array.from({ length: 300 }, (_, i) => {
    const z = 1 - (2 * i + 1) / 300;
    const r = Math.sqrt(1 - z * z);
    return `${r * Math.cos(i * 2.399963)} ${r * Math.sin(i * 2.399963)} ${z}`;
  }).join('\n'));
  await page.locator('input[type=file]').first().setInputFiles([path, small]);
  const address = (await begun).headers().location;
  await page.getByText('The upload goes on by itself from where it was cut.').waitFor();
  through.cutAfter = Infinity;
  through.cut = false;
  const erased = page.waitForResponse((response) => response.request().method() === 'DELETE');
  await page.getByRole('button', { name: 'Remove other.ply' }).click();
  assert.equal((await erased).status(), 204);
  await page.getByText('300 points').waitFor();
  assert.equal((await fetch(`${origin}${address}`)).status, 410);
  await page.context().close();
});
