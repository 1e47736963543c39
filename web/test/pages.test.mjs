// Every page in both themes: no fault that axe knows, nothing that is wider than the window. Asked to
// (PICTURES), it also takes the pictures of docs/.

import assert from 'node:assert/strict';
import { join } from 'node:path';
import { before, test } from 'node:test';
import { browse, drop, ended, folder, open, root, sample, serve, shared, submit, violations } from './support.mjs';

const PICTURES = process.env.PICTURES ? join(root, 'docs') : null;

/** The pictures have a finer mesh, and take longer. */
const POINTS = PICTURES ? 3000 : 900;
const points = `${POINTS.toLocaleString('en')} points`;
const triangles = new RegExp(`[1-9][\\d,]* triangles, ${points}`);

const t = shared();
let origin;
let browser;
let clouds;
let jobs;

before(async () => {
  clouds = folder(t);
  origin = (await serve(t, folder(t))).origin;
  browser = await browse(t);
  const hand = sample(clouds, 'hand', POINTS);
  const small = { surface: { resolution: PICTURES ? 128 : 48 }, network: { block_points: 0 } };
  const job = (file, settings, labels = {}) => ({ preset: 'fast', settings: { ...small, ...settings }, labels: { file, ...labels } });
  jobs = [];
  for (const request of [
    job('hand.ply', {}, { patient: 'p7' }),
    job('hand.ply', { training: { max_evaluations: 60 } }, { patient: 'p7' }),
    job('short.ply', { training: { max_evaluations: 5 } }),
  ]) {
    const { id } = await submit(origin, hand, request);
    await ended(origin, id);
    jobs.push(id);
  }
  // Adam on one network never ends by itself.
  const training = { optimizer: 'adam', max_evaluations: 1_000_000, patience: 0, snapshot_evaluations: [10] };
  const long = { preset: 'fine', settings: { training, network: { block_points: 0 } }, labels: { file: 'knee.ply' } };
  jobs.push((await submit(origin, hand, long)).id);
  jobs.push((await submit(origin, hand, job('waits.ply', {}))).id);
});

const settled = (page) => page.getByText('Loading…').first().waitFor({ state: 'hidden' });

/** Each page: its address, and when all of it is there. */
const PAGES = [
  { name: 'jobs', at: () => '#/jobs', ready: (page) => page.getByRole('progressbar', { name: 'Progress of knee.ply' }).waitFor() },
  { name: 'jobs-chosen', at: () => '#/jobs?status=succeeded', ready: async (page) => {
    await page.getByRole('checkbox', { name: 'Choose hand.ply' }).first().check();
    await page.getByRole('group', { name: 'Chosen jobs' }).waitFor();
  } },
  { name: 'nothing', at: () => '#/jobs?label=patient:nobody', ready: (page) => page.getByText('No job matches.').waitFor() },
  { name: 'new', at: () => '#/new', ready: async (page) => {
    await drop(page, join(clouds, 'hand.ply'), 'hand.ply');
    await page.getByText(points).waitFor();
    await page.getByLabel('Neurons per layer').fill('0');
    await page.locator('.field .fault').waitFor();
  } },
  { name: 'job', at: () => `#/jobs/${jobs[0]}`, ready: async (page) => {
    await page.getByRole('application', { name: triangles }).waitFor();
    await page.getByRole('img', { name: /^Loss from/ }).waitFor();
    await page.getByRole('combobox', { name: 'Colour' }).selectOption('points');
    await page.locator('.picture').click();
  } },
  { name: 'job-running', at: () => `#/jobs/${jobs[3]}`, ready: async (page) => {
    await page.getByRole('application', { name: triangles }).waitFor();
    await page.getByRole('img', { name: /^Loss from/ }).waitFor();
  } },
  { name: 'question', at: () => `#/jobs/${jobs[4]}`, ready: async (page) => {
    await page.getByText('number 1 in the queue').waitFor();
    await page.getByRole('button', { name: 'Delete' }).click();
    await page.getByRole('dialog').waitFor();
  } },
  { name: 'compare', at: () => `#/compare?a=${jobs[0]}&b=${jobs[1]}`, ready: async (page) => {
    await page.getByRole('application', { name: triangles }).nth(1).waitFor();
    await page.getByRole('img', { name: /^First from/ }).waitFor();
    await page.getByRole('combobox', { name: 'Colour' }).last().selectOption('other');
    await page.locator('.legend').getByText('Distance to the other mesh').last().waitFor();
  } },
  { name: 'system', at: () => '#/system', ready: (page) => page.getByText('Workers busy').waitFor() },
  { name: 'missing', at: () => '#/nowhere', ready: (page) => page.getByText('There is no such page.').waitFor() },
];

for (const colorScheme of ['light', 'dark']) {
  test(`every page is accessible, ${colorScheme}`, async () => {
    const { page, faults } = await open(browser, origin, { colorScheme });
    const all = [];
    for (const { name, at, ready } of PAGES) {
      await page.goto(`${origin}/${at()}`);
      await ready(page);
      await settled(page);
      const found = [...await violations(page), ...faults.splice(0)];
      // The form shows a mistake on purpose, which the service refuses.
      const meant = (fault) => name === 'new' && fault.includes('422');
      all.push(...found.filter((fault) => !meant(fault)).map((fault) => `${name}: ${fault}`));
      const shown = { light: ['jobs', 'job', 'compare', 'system'], dark: ['new', 'job-running'] };
      if (name === 'job') await page.getByRole('combobox', { name: 'Colour' }).selectOption('');
      await page.evaluate(() => scrollTo(0, 0));
      if (PICTURES && shown[colorScheme].includes(name)) await page.screenshot({ path: join(PICTURES, `web-${name}.png`) });
    }
    assert.deepEqual(all, []);
    await page.context().close();
  });
}

test('nothing is wider than a telephone or a tablet', async () => {
  const all = [];
  for (const width of [360, 768]) {
    const { page } = await open(browser, origin, { viewport: { width, height: 800 } });
    for (const { name, at, ready } of PAGES) {
      await page.goto(`${origin}/${at()}`);
      await ready(page);
      const wide = await page.evaluate(() => document.documentElement.scrollWidth);
      if (wide > width) all.push(`${name} is ${wide} wide at ${width}`);
    }
    await page.context().close();
  }
  assert.deepEqual(all, []);
});
