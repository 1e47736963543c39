// How jobs stand: in the queue, how long they are kept, and block by block.

import assert from 'node:assert/strict';
import { before, test } from 'node:test';
import { browse, busy, ended, folder, open, sample, serve, shared, submit, violations } from './support.mjs';

const t = shared();
let origin;
let browser;
let cloud;

before(async () => {
  origin = (await serve(t, folder(t))).origin;
  browser = await browse(t);
  cloud = sample(folder(t), 'hand', 600);
});

const small = { surface: { resolution: 32 } };

async function accessible(page) {
  for (const colorScheme of ['light', 'dark']) {
    await page.emulateMedia({ colorScheme });
    assert.deepEqual(await violations(page), []);
  }
}

test('each block has its numbers on request, and the page says how long a job is kept', async () => {
  const { page, faults } = await open(browser, origin);
  const fine = sample(folder(t), 'hand', 2000);
  const training = { max_evaluations: 30, block_evaluations: 15 };
  const { id } = await submit(origin, fine, { preset: 'fast', settings: { ...small, training }, labels: { file: 'blocks.ply' }, ttl: '30d' });
  assert.equal((await ended(origin, id)).status, 'succeeded');
  const { blocks, series } = await (await fetch(`${origin}/v1/jobs/${id}/metrics?blocks=true`)).json();
  assert.ok(blocks > 1);
  assert.equal(series.loss.length, blocks);
  await page.goto(`${origin}/#/jobs/${id}`);
  await page.getByText('will be erased').waitFor();
  await page.getByRole('img', { name: /^Loss from/ }).waitFor();
  await page.getByRole('combobox', { name: 'Curve' }).selectOption('Each block');
  await page.getByRole('img', { name: /Loss at the end between .* and / }).waitFor();
  await page.getByText(new RegExp(`^${blocks} blocks\\. Their trainings ended by: `)).waitFor();
  await page.locator('.chart canvas').waitFor();
  await accessible(page);

  await page.goto(`${origin}/#/jobs`);
  await page.getByRole('row', { name: /blocks\.ply.*Erased / }).waitFor();
  const held = await fetch(`${origin}/v1/jobs/${id}`, {
    method: 'PATCH', headers: { 'content-type': 'application/json' }, body: JSON.stringify({ hold: true }),
  });
  assert.equal(held.status, 200);
  await page.reload();
  await page.getByRole('row', { name: /blocks\.ply.*Held/ }).waitFor();
  await page.getByRole('link', { name: 'blocks.ply' }).click();
  await page.getByText('held: it cannot be erased until it is let go').waitFor();
  assert.deepEqual(faults, []);
  await page.context().close();
});

test('a job that waits says its place, its end and its priority', async () => {
  const { page, faults } = await open(browser, origin);
  const { id: first } = await busy(origin, cloud, { file: 'long.ply' });
  const later = await submit(origin, cloud, { preset: 'fast', settings: small, labels: { file: 'later.ply' } });
  await submit(origin, cloud, { preset: 'fast', settings: small, labels: { file: 'urgent.ply' }, priority: 3 });
  await page.goto(`${origin}/#/jobs`);
  await page.getByRole('row', { name: /urgent\.ply.*priority \+3 Number 1 in the queue, done in about / }).waitFor();
  await page.getByRole('row', { name: /later\.ply.*Number 2 in the queue, done in about / }).waitFor();
  await accessible(page);
  await page.goto(`${origin}/#/jobs/${later.id}`);
  await page.getByText(/^Waits for a worker, number 2 in the queue, done in about .*\./).waitFor();
  await accessible(page);
  await fetch(`${origin}/v1/jobs/${first}/cancel`, { method: 'POST' });
  await page.locator('.page-head .badge', { hasText: 'Succeeded' }).waitFor();
  assert.deepEqual(faults, []);
  await page.context().close();
});
