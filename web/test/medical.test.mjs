// Segmentations of medical images: their parts are chosen, and each becomes a job.

import assert from 'node:assert/strict';
import { join } from 'node:path';
import { before, test } from 'node:test';
import { gunzipSync } from 'node:zlib';
import { browse, EDGE, ended, folder, nifti, open, serve, shared, violations } from './support.mjs';

const t = shared();
let origin;
let browser;
let files;

before(async () => {
  files = folder(t);
  origin = (await serve(t, folder(t))).origin;
  browser = await browse(t);
});

/** Balls of a label each. */
const BALLS = [
  { label: 1, centre: [7, 7, 12], radius: 5 },
  { label: 3, centre: [16, 16, 12], radius: 6 },
  { label: 9, centre: [18, 5, 8], radius: 4 },
];

const give = (page, path) => page.locator('input[type=file]').first().setInputFiles(path);

/** The first vertex of an OBJ file. */
const vertexOf = (content) => content.toString().match(/^v (.*)$/m)[1].split(' ').map(Number);
const vertex = async (path) => vertexOf(await (await fetch(`${origin}${path}`)).text());

/** The service refuses on purpose, and the browser notes that. */
const unmeant = (faults) => faults.filter((fault) => !fault.includes('422'));

async function fast(page) {
  await page.getByText('Fast', { exact: true }).click();
  await page.getByLabel('Training steps').fill('40');
  await page.getByLabel('Grid resolution').fill('32');
}

test('the labels of a file are chosen from, and each becomes a job', async () => {
  const { page, faults } = await open(browser, origin);
  const { path, voxels } = nifti(join(files, 'organs.nii'), BALLS);
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
  // What the browser does with a link is tried with STL (way.test.mjs).
  const take = async (name) => {
    const answer = await fetch(`${origin}${await page.getByRole('link', { name, exact: true }).getAttribute('href')}`);
    assert.equal(answer.status, 200, name);
    return Buffer.from(await answer.arrayBuffer());
  };
  for (const [name, begin] of [
    ['PLY', 'ply'], ['OBJ', '#'], ['GLB', 'glTF'], ['OFF', 'OFF'], ['3MF', 'PK'], ['VTP', '<?xml'], ['PLY in colours', 'ply'], ['GLB in colours', 'glTF'],
    ['Report, as JSON', '{'], ['Curves, as CSV', 'evaluation'], ['The file as uploaded', '\\\x01'],
  ]) assert.equal((await take(name)).subarray(0, begin.length).toString('latin1'), begin, name);
  assert.equal((await take('DICOM')).subarray(128, 132).toString('latin1'), 'DICM');
  // The mask has the voxels of the file, and those of the label nearly.
  const mask = gunzipSync(await take('Mask, as NIfTI'));
  assert.deepEqual([1, 2, 3].map((axis) => mask.readInt16LE(40 + 2 * axis)), [EDGE, EDGE, EDGE]);
  const inside = mask.subarray(352).filter((value) => value === 1).length;
  assert.ok(Math.abs(inside / voxels(3) - 1) < 0.15, `${inside} voxels of ${voxels(3)}`);
  await page.getByLabel('Coordinates').selectOption('RAS, as NIfTI has them');
  const [lps, ras] = [await vertex(`/v1/jobs/${job.id}/mesh.obj`), vertexOf(await take('OBJ'))];
  assert.deepEqual(ras, [-lps[0], -lps[1], lps[2]]);
  assert.equal(await page.getByRole('link', { name: 'DICOM' }).count(), 0);
  assert.deepEqual(await violations(page), []);
  assert.deepEqual(unmeant(faults), []);
  await page.context().close();
});

test('a file that does not say how it lies is taken as it lies when the user says so', async () => {
  const { page, faults } = await open(browser, origin);
  await page.goto(`${origin}/#/new`);
  await give(page, nifti(join(files, 'nowhere.nii'), BALLS.slice(0, 1), false).path);
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
  await page.getByText("/v1/jobs?assume_orientation=true'").waitFor();
  await page.getByRole('button', { name: 'Python' }).click();
  await page.getByText('assume_orientation=True').waitFor();
  assert.deepEqual(unmeant(faults), []);
  await page.context().close();
});

test('the picture says where the sides of a patient are', async () => {
  const { page, faults } = await open(browser, origin);
  await page.goto(`${origin}/#/jobs`);
  await page.getByRole('link', { name: 'organs.nii, 1' }).click();
  await page.getByRole('application', { name: /[1-9][\d,]* triangles/ }).waitFor();
  const place = async (side) => {
    await page.getByRole('button', { name: side }).click();
    await page.keyboard.press('Escape');
    await page.locator('.picture').press('Enter');
    const text = await page.locator('.picks code').textContent();
    await page.locator('.picture').press('Escape');
    return text.split(', ').map(Number);
  };
  // In LPS x leads to the left, y to the back and z to the head; a view looks at its own side.
  const [left, right] = [await place('Left L'), await place('Right R')];
  assert.ok(left[0] > right[0] + 5, `${left} ${right}`);
  const [front, back] = [await place('Front A'), await place('Back P')];
  assert.ok(front[1] < back[1] - 5, `${front} ${back}`);
  const [top, bottom] = [await place('Top S'), await place('Bottom I')];
  assert.ok(top[2] > bottom[2] + 5, `${top} ${bottom}`);
  await page.getByRole('combobox', { name: 'Cut' }).selectOption('Across z, axial');
  await page.locator('.picture').click();
  await page.keyboard.press('Home');
  await page.locator('.picture').press('Enter');
  await page.getByText(/distance .* mm/).waitFor();
  assert.deepEqual(faults, []);
  await page.context().close();
});
