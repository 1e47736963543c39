// From a dropped file to a downloaded mesh, with a mouse and with keys alone.

import assert from 'node:assert/strict';
import { createHash } from 'node:crypto';
import { readFileSync } from 'node:fs';
import { before, test } from 'node:test';
import { browse, colours, drop, folder, open, sample, serve, shared, submit, violations } from './support.mjs';

const t = shared();
let origin;
let browser;
let clouds;

before(async () => {
  clouds = folder(t);
  origin = (await serve(t, folder(t))).origin;
  browser = await browse(t);
});

const sha256 = (bytes) => createHash('sha256').update(bytes).digest('hex');
const status = (page, word) => page.locator('.page-head .badge', { hasText: word }).waitFor();

test('a dropped file becomes a mesh that can be turned and downloaded', async () => {
  const { page, faults } = await open(browser, origin);
  await page.goto(`${origin}/`);
  await page.getByText('Drop a point cloud anywhere on this page.').waitFor();
  await drop(page, sample(clouds, 'sphere', 300), 'ball.ply');
  await page.getByText('300 points').waitFor();
  await page.getByText('Fast', { exact: true }).click();
  await page.locator('.numbers').getByText('Triangles').waitFor();
  await page.getByRole('button', { name: 'Start' }).click();
  await page.getByRole('heading', { name: 'ball.ply' }).waitFor();
  await status(page, 'Succeeded');
  const id = page.url().split('/').at(-1);

  await page.getByText('The mesh is closed, in one piece.').waitFor();
  await page.getByRole('img', { name: /^Loss from/ }).waitFor();
  const { series } = await (await fetch(`${origin}/v1/jobs/${id}/metrics`)).json();
  assert.ok(series.loss.length > 3);

  await page.getByRole('application', { name: /[1-9][\d,]* triangles, 300 points/ }).waitFor();
  const taken = page.waitForEvent('download');
  await page.getByRole('button', { name: 'Save picture' }).click();
  const picture = readFileSync(await (await taken).path());
  assert.ok(await colours(page, picture) > 20, 'the picture shows nothing');

  const coming = page.waitForEvent('download');
  await page.getByRole('link', { name: 'Download STL' }).click();
  const mesh = readFileSync(await (await coming).path());
  const answer = await fetch(`${origin}/v1/jobs/${id}/mesh.stl`);
  assert.equal(sha256(mesh), sha256(Buffer.from(await answer.arrayBuffer())));
  assert.equal(answer.headers.get('etag'), `"${sha256(mesh)}"`);
  assert.deepEqual(faults, []);
  await page.context().close();
});

test('a page that is loaded again in the middle goes on, and the job can be cancelled and deleted', async () => {
  const long = { preset: 'fine', settings: { training: { optimizer: 'adam', max_evaluations: 1_000_000, patience: 0 }, network: { block_points: 0 } }, labels: { file: 'long.ply' } };
  const { id } = await submit(origin, sample(clouds, 'hand', 2000), long);
  const { page, faults } = await open(browser, origin);
  await page.goto(`${origin}/#/jobs/${id}`);
  await status(page, 'Running');
  await page.getByRole('img', { name: /^Loss from/ }).waitFor();
  await page.reload();
  await status(page, 'Running');
  await page.locator('.steps .now', { hasText: 'Train' }).waitFor();
  const label = () => page.getByRole('img', { name: /^Loss from/ }).getAttribute('aria-label');
  const first = await label();
  await page.waitForFunction((old) => document.querySelector('.chart')?.getAttribute('aria-label') !== old, first);

  await page.goto(`${origin}/#/jobs?status=running`);
  await page.getByRole('link', { name: 'long.ply' }).waitFor();
  await page.getByRole('checkbox', { name: 'Choose long.ply' }).check();
  await page.getByRole('group', { name: 'Chosen jobs' }).getByRole('button', { name: 'Cancel' }).click();
  await page.getByRole('dialog').getByRole('button', { name: 'Cancel' }).click();
  await page.getByText('No job matches.').waitFor();

  await page.goto(`${origin}/#/jobs/${id}`);
  await status(page, 'Cancelled');
  await page.getByRole('button', { name: 'Delete' }).click();
  await page.getByRole('dialog').getByRole('button', { name: 'Keep' }).click();
  await page.getByRole('button', { name: 'Delete' }).click();
  await page.getByRole('dialog').waitFor();
  // Who leaves with a question open does not want it.
  await page.goto(`${origin}/#/system`);
  await page.getByRole('dialog').waitFor({ state: 'hidden' });
  await page.goBack();
  await page.getByRole('button', { name: 'Delete' }).click();
  await page.getByRole('dialog').getByRole('button', { name: 'Delete' }).click();
  await page.getByRole('heading', { name: 'Jobs' }).waitFor();
  assert.equal((await fetch(`${origin}/v1/jobs/${id}`)).status, 410);
  assert.deepEqual(faults, []);
  await page.context().close();
});

test('keys alone do all of it', async () => {
  const { page, faults } = await open(browser, origin);
  // Files are asked for by the test from now on: told late, the browser would ask itself.
  page.on('filechooser', () => {});
  await page.goto(`${origin}/`);
  const tabTo = async (name) => {
    for (let i = 0; i < 80; i += 1) {
      await page.keyboard.press('Tab');
      const found = await page.evaluate(() => {
        const { activeElement: at } = document;
        const style = getComputedStyle(at);
        const label = at.getAttribute('aria-label') ?? at.labels?.[0]?.textContent ?? at.textContent;
        // Behind the last element the focus is nowhere, before the first.
        const shown = at === document.body || style.outlineStyle !== 'none' || at.closest('label:has(:focus-visible)') !== null;
        return { label: label.trim(), shown };
      });
      assert.ok(found.shown, `nothing shows that ${found.label} has the focus`);
      if (found.label.startsWith(name)) return;
    }
    assert.fail(`no ${name} is reached`);
  };
  await tabTo('Choose files');
  const asked = page.waitForEvent('filechooser');
  await page.keyboard.press('Enter');
  await (await asked).setFiles(sample(clouds, 'sphere', 400, 'orb.ply'));
  await page.getByText('400 points').waitFor();
  assert.equal(await page.evaluate(() => document.activeElement.textContent), 'New job');
  await tabTo('Balanced');
  await page.keyboard.press('ArrowUp');
  await tabTo('Start');
  await page.keyboard.press('Enter');
  await page.getByRole('heading', { name: 'orb.ply' }).waitFor();
  await status(page, 'Succeeded');
  await page.getByRole('application', { name: /[1-9][\d,]* triangles/ }).waitFor();
  await tabTo('orb.ply: ');
  const before = await page.locator('.picture').screenshot();
  await page.keyboard.press('ArrowLeft');
  await page.keyboard.press('ArrowUp');
  await page.keyboard.press('+');
  // It is drawn with the next frame.
  let after = before;
  while (sha256(after) === sha256(before)) after = await page.locator('.picture').screenshot();
  await page.keyboard.press('Home');
  await page.keyboard.press('Enter');
  await page.getByText(/^Place /).waitFor();
  await tabTo('Delete');
  await page.keyboard.press('Enter');
  await page.getByRole('dialog').waitFor();
  await page.keyboard.press('Escape');
  await page.getByRole('dialog').waitFor({ state: 'hidden' });
  assert.deepEqual(faults, []);
  await page.context().close();
});

test('one click compares the schemes of the publication', async () => {
  const { page, faults } = await open(browser, origin);
  await page.goto(`${origin}/#/new`);
  await drop(page, sample(clouds, 'sphere', 300), 'ball.ply');
  await page.getByText('Fast', { exact: true }).click();
  await page.getByLabel('Training steps').fill('40');
  await page.getByLabel('Grid resolution').fill('32');
  await page.getByLabel(/^One job for each of the five schemes/).check();
  await page.getByRole('button', { name: 'Start 5 jobs' }).click();
  for (const scheme of ['plain', 'resnet', 'highway', 'hw', 'sqrhw']) {
    await page.getByRole('row', { name: new RegExp(`^${scheme} (Good|Doubtful|Poor)`) }).waitFor();
  }
  await page.getByRole('img', { name: /^plain from.*; sqrhw from/ }).waitFor();
  // As in its figures: the norms of the weights and the gradients, of each scheme beside the others.
  await page.getByRole('combobox', { name: 'Shown' }).selectOption('Weight norms, by layer');
  await page.getByRole('img', { name: /^Layer 1 from/ }).nth(4).waitFor();
  await page.getByRole('combobox', { name: 'Shown' }).selectOption('Gradients, by layer');
  await page.getByRole('img', { name: /linear/ }).nth(4).waitFor();
  await page.getByRole('link', { name: 'sqrhw' }).click();
  // The comparison, which has five of what comes next, is gone.
  await page.getByRole('heading', { name: 'Compare' }).waitFor({ state: 'detached' });
  await page.getByText('Components of the gradient').waitFor();
  await page.getByRole('img', { name: /linear/ }).waitFor();
  assert.deepEqual(await violations(page), []);
  await page.goBack();
  await page.getByRole('row', { name: /^plain (Good|Doubtful|Poor)/ }).waitFor();
  assert.deepEqual(await violations(page), []);
  assert.deepEqual(faults, []);
  await page.context().close();
});
