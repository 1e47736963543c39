// Segmentations of medical images: their parts are chosen, and each becomes a job.

import assert from 'node:assert/strict';
import { writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { before, test } from 'node:test';
import { browse, ended, folder, open, serve, shared, violations } from './support.mjs';

const t = shared();
let origin;
let browser;
let files;

before(async () => {
  files = folder(t);
  origin = (await serve(t, folder(t))).origin;
  browser = await browse(t);
});

/** Voxels along an edge. */
const EDGE = 24;

/** Balls of a label each. */
const BALLS = [
  { label: 1, centre: [7, 7, 12], radius: 5 },
  { label: 3, centre: [16, 16, 12], radius: 6 },
  { label: 9, centre: [18, 5, 8], radius: 4 },
];

/** A NIfTI-1 label map of balls, with or without its place in the patient. */
function nifti(name, balls, placed = true) {
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
  const path = join(files, name);
  writeFileSync(path, Buffer.concat([head, voxels]));
  return { path, voxels: (label) => voxels.filter((value) => value === label).length };
}

const give = (page, path) => page.locator('input[type=file]').first().setInputFiles(path);

/** The service refuses on purpose, and the browser notes that. */
const unmeant = (faults) => faults.filter((fault) => !fault.includes('422'));

async function fast(page) {
  await page.getByText('Fast', { exact: true }).click();
  await page.getByLabel('Training steps').fill('40');
  await page.getByLabel('Grid resolution').fill('32');
}

test('the labels of a file are chosen from, and each becomes a job', async () => {
  const { page, faults } = await open(browser, origin);
  const { path, voxels } = nifti('organs.nii', BALLS);
  await page.goto(`${origin}/#/new`);
  await give(page, path);
  const parts = page.getByRole('group', { name: 'Labels of organs.nii that become surfaces, a job each' });
  for (const { label } of BALLS) {
    await parts.getByRole('checkbox', { name: `Label ${label} ${voxels(label)} voxels` }).waitFor();
  }
  // What the API says stands at the field, and nothing can be started.
  await parts.getByText('the file holds the labels 1, 3, 9; choose one').waitFor();
  assert.equal(await page.getByRole('button', { name: 'Start' }).isEnabled(), false);
  for (const colorScheme of ['light', 'dark']) {
    await page.emulateMedia({ colorScheme });
    assert.deepEqual(await violations(page), []);
  }
  // Keys alone.
  await parts.getByRole('button', { name: 'Choose all' }).press('Enter');
  await page.getByText('3 of 3 chosen').waitFor();
  await page.getByRole('button', { name: 'Start 3 jobs' }).waitFor();
  await parts.getByRole('checkbox', { name: /^Label 9/ }).press('Space');
  await page.getByText('2 of 3 chosen').waitFor();
  await page.locator('.numbers').getByText('Triangles').waitFor();
  assert.equal(await parts.locator('.fault').count(), 0);
  await fast(page);
  await page.getByRole('button', { name: 'Start 2 jobs' }).click();
  await page.getByRole('link', { name: 'organs.nii, 3' }).waitFor();
  await page.getByRole('link', { name: 'organs.nii, 1' }).waitFor();
  const { items } = await (await fetch(`${origin}/v1/jobs`)).json();
  assert.deepEqual(items.map(({ source }) => source).reverse(), [{ label: 1 }, { label: 3 }]);
  const job = await ended(origin, items[0].id);
  assert.equal(job.status, 'succeeded');

  await page.getByRole('link', { name: 'organs.nii, 3' }).click();
  await page.getByRole('heading', { name: 'organs.nii, 3' }).waitFor();
  await page.getByRole('application', { name: /[1-9][\d,]* triangles/ }).waitFor();
  await page.getByText('"source":{"label":3}').waitFor();
  for (const name of ['DICOM', '3MF', 'VTP']) {
    const coming = page.waitForEvent('download');
    await page.getByRole('link', { name, exact: true }).click();
    assert.equal(await (await coming).failure(), null);
  }
  assert.deepEqual(await violations(page), []);
  assert.deepEqual(unmeant(faults), []);
  await page.context().close();
});

test('a file that does not say how it lies is taken as it lies when the user says so', async () => {
  const { page, faults } = await open(browser, origin);
  await page.goto(`${origin}/#/new`);
  await give(page, nifti('nowhere.nii', BALLS.slice(0, 1), false).path);
  await page.getByRole('alert').getByText('left and right could be swapped').waitFor();
  assert.deepEqual(await violations(page), []);
  await page.getByRole('button', { name: 'Take it as it lies' }).press('Enter');
  await page.getByText('left and right may be swapped').waitFor();
  // The only label is chosen by itself.
  assert.ok(await page.getByRole('checkbox', { name: /^Label 1/ }).isChecked());
  await fast(page);
  await page.getByRole('button', { name: 'Start', exact: true }).click();
  await page.getByRole('heading', { name: 'nowhere.nii, 1' }).waitFor();
  const id = page.url().split('/').at(-1);
  assert.deepEqual((await (await fetch(`${origin}/v1/jobs/${id}`)).json()).source, { label: 1 });
  assert.deepEqual(unmeant(faults), []);
  await page.context().close();
});
