// What is done to jobs besides looking at them: holding, keeping, giving way; one, chosen ones, all with a label.

import assert from 'node:assert/strict';
import { before, test } from 'node:test';
import { browse, busy, drop, ended, folder, open, sample, serve, shared, submit, violations } from './support.mjs';

const t = shared();
let origin;
let browser;
let cloud;

const small = { surface: { resolution: 32 }, training: { max_evaluations: 30 } };
const fast = (labels) => ({ preset: 'fast', settings: small, labels });

before(async () => {
  origin = (await serve(t, folder(t), '127.0.0.1:0', ['--job-ttl', '30d'])).origin;
  browser = await browse(t);
  cloud = sample(folder(t), 'sphere', 300);
});

const show = async (id) => (await fetch(`${origin}/v1/jobs/${id}`)).json();
/** Refused on purpose: the browser notes that. */
const unmeant = (faults) => faults.filter((fault) => !fault.includes('409'));

async function accessible(page) {
  for (const colorScheme of ['light', 'dark']) {
    await page.emulateMedia({ colorScheme });
    assert.deepEqual(await violations(page), []);
  }
}

test('a job is held and let go, and kept for another time', async () => {
  const { id } = await submit(origin, cloud, fast({ file: 'kept.ply' }));
  await ended(origin, id);
  const { page, faults } = await open(browser, origin);
  await page.goto(`${origin}/#/jobs/${id}`);
  const keeping = page.getByRole('region', { name: 'Keeping' });
  await keeping.getByRole('button', { name: 'Hold' }).click();
  await page.getByText('held: it cannot be erased until it is let go').waitFor();
  await page.getByRole('button', { name: 'Delete' }).click();
  await page.getByRole('dialog').getByRole('button', { name: 'Delete' }).click();
  await page.getByRole('status').getByText('0 of 1 job.').waitFor();
  assert.equal((await show(id)).hold, true);
  await keeping.getByRole('button', { name: 'Let go' }).click();
  await page.getByText('will be erased').waitFor();
  assert.equal(await keeping.getByRole('button', { name: 'Save' }).isEnabled(), false);
  await keeping.getByLabel('Kept after its end').selectOption('For ever');
  await accessible(page);
  await keeping.getByRole('button', { name: 'Save' }).click();
  await page.getByText('will be erased').waitFor({ state: 'hidden' });
  const { ttl, hold, expires_at: end } = await show(id);
  assert.deepEqual([ttl, hold, end], [null, false, null]);
  assert.deepEqual(unmeant(faults), []);
  await page.context().close();
});

test('a job that waits goes past another, and a new one says its turn and its time', async () => {
  const { id: long } = await busy(origin, cloud, { file: 'long.ply' });
  await submit(origin, cloud, fast({ file: 'first.ply' }));
  const { page, faults } = await open(browser, origin);
  await page.goto(`${origin}/#/new`);
  await drop(page, cloud, 'second.ply');
  await page.getByText('300 points').waitFor();
  await page.getByText('Fast', { exact: true }).click();
  await page.getByLabel('Kept after its end').selectOption('Until its mesh is downloaded');
  await page.getByLabel('Priority in the queue').selectOption('−9, last of all');
  await page.getByRole('button', { name: 'Start' }).click();
  await page.getByRole('heading', { name: 'second.ply' }).waitFor();
  const id = page.url().split('/').at(-1);
  const { ttl, priority } = await show(id);
  assert.deepEqual([ttl, priority], ['download', -9]);
  await page.getByText('number 2 in the queue').waitFor();
  const keeping = page.getByRole('region', { name: 'Keeping' });
  await keeping.getByLabel('Priority in the queue').selectOption('+3');
  await keeping.getByRole('button', { name: 'Save' }).click();
  await page.getByText('number 1 in the queue').waitFor();
  await page.getByText('priority +3', { exact: true }).waitFor();
  assert.equal((await show(id)).priority, 3);
  await fetch(`${origin}/v1/jobs/${long}`, { method: 'DELETE' });
  assert.deepEqual(faults, []);
  await page.context().close();
});

test('chosen jobs are held together, and all with a label are cancelled or deleted', async () => {
  const of = { study: 'a:b' };
  const ids = [];
  for (let i = 0; i < 3; i += 1) ids.push((await submit(origin, cloud, fast({ file: `study-${i}.ply`, ...of }))).id);
  await submit(origin, cloud, fast({ file: 'other.ply' }));
  for (const id of ids) await ended(origin, id);
  const { page, faults } = await open(browser, origin);
  await page.goto(`${origin}/#/jobs`);
  await page.getByRole('row', { name: /study-1\.ply/ }).getByRole('link', { name: 'study: a:b' }).click();
  await page.getByText('3 jobs', { exact: true }).waitFor();
  await page.getByRole('checkbox', { name: 'Choose study-1.ply' }).check();
  await page.getByRole('group', { name: 'Chosen jobs' }).getByRole('button', { name: 'Hold' }).click();
  await page.getByRole('row', { name: /study-1\.ply.*Held/ }).waitFor();
  const all = page.getByRole('group', { name: 'All jobs with study:a:b' });
  await accessible(page);
  await all.getByRole('button', { name: 'Cancel all' }).click();
  await page.getByText('No job with study:a:b waits or runs.').waitFor();
  const { id } = await busy(origin, cloud, of);
  await page.getByText('4 jobs', { exact: true }).waitFor();
  await all.getByRole('button', { name: 'Cancel all' }).click();
  await page.getByRole('dialog').getByRole('button', { name: 'Cancel' }).click();
  assert.equal((await ended(origin, id)).status, 'cancelled');
  await all.getByRole('button', { name: 'Delete all' }).click();
  await page.getByRole('dialog').getByRole('button', { name: 'Delete all' }).click();
  await page.getByText('1 held, which stay').waitFor();
  await page.getByText('1 job', { exact: true }).waitFor();
  assert.equal((await show(ids[1])).hold, true);
  assert.equal((await fetch(`${origin}/v1/jobs/${ids[0]}`)).status, 410);
  assert.deepEqual(faults, []);
  await page.context().close();
});
