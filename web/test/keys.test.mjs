// A service with keys: the page asks for one, keeps it where no script reads it, and forgets it when asked to.

import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { readFileSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { test } from 'node:test';
import { browse, folder, open, program, sample, serve, shared, violations } from './support.mjs';

const t = shared();

test('people sign in with a key and out again', async () => {
  const data = folder(t);
  const made = spawnSync(program, ['key', 'new', '--name', 'anna', '--scopes', 'read,write'], { encoding: 'utf8' });
  assert.equal(made.status, 0, made.stderr);
  const key = made.stdout.match(/mw_[0-9A-Za-z]+/)[0];
  const config = join(folder(t), 'clinic.toml');
  writeFileSync(config, made.stdout.slice(made.stdout.indexOf('[[keys]]')));
  const { origin } = await serve(t, data, '127.0.0.1:0', ['--config', config]);
  const { page } = await open(await browse(t), origin);
  await page.goto(`${origin}/`);
  const field = page.getByLabel('Key');
  await field.waitFor();
  assert.deepEqual(await violations(page), []);
  await field.fill(`${key.slice(0, -1)}${key.endsWith('a') ? 'b' : 'a'}`);
  await page.getByRole('button', { name: 'Sign in with the key' }).click();
  await page.getByRole('alert').waitFor();
  await field.fill(key);
  await page.getByRole('button', { name: 'Sign in with the key' }).click();
  await page.getByText('Live').waitFor();
  assert.equal(await page.evaluate(() => document.cookie), '');
  await page.getByRole('button', { name: 'Sign out' }).click();
  await field.waitFor();
});

test('people sign in with a name and a password and out again', async () => {
  const made = spawnSync(program, ['user', 'passwd', 'anna'], { encoding: 'utf8', input: 'correct horse ä\n' });
  assert.equal(made.status, 0, made.stderr);
  const config = join(folder(t), 'clinic.toml');
  writeFileSync(config, made.stdout);
  const { origin } = await serve(t, folder(t), '127.0.0.1:0', ['--config', config]);
  const { page } = await open(await browse(t), origin);
  await page.goto(`${origin}/`);
  const password = page.getByLabel('Password');
  await password.waitFor();
  assert.deepEqual(await violations(page), []);
  await page.getByLabel('Name').fill('anna');
  await password.fill('wrong horse');
  const signIn = page.getByRole('button', { name: 'Sign in', exact: true });
  await signIn.click();
  await page.getByRole('alert').waitFor();
  await password.fill('correct horse ä');
  await signIn.click();
  await page.getByText('Live').waitFor();
  assert.equal(await page.evaluate(() => document.cookie), '');
  await page.getByRole('button', { name: 'Sign out' }).click();
  await password.waitFor();
});

test('each sees what the key allows: who looks, who makes keys, who reads the trail', async () => {
  const [data, config] = [folder(t), join(folder(t), 'clinic.toml')];
  const given = { reader: 'read', maker: 'read,write,delete,admin', auditor: 'read,audit' };
  const blocks = [];
  const keys = Object.fromEntries(Object.entries(given).map(([name, scopes]) => {
    const { stdout } = spawnSync(program, ['key', 'new', '--name', name, '--scopes', scopes], { encoding: 'utf8' });
    blocks.push(stdout.slice(stdout.indexOf('[[keys]]')));
    return [name, stdout.match(/mw_[0-9A-Za-z]+/)[0]];
  }));
  writeFileSync(config, blocks.join('\n'));
  const { origin } = await serve(t, data, '127.0.0.1:0', ['--config', config, '--job-ttl', '7d']);
  const browser = await browse(t);
  const enter = async (key) => {
    const opened = await open(browser, origin);
    await opened.page.goto(`${origin}/#/system`);
    await opened.page.getByLabel('Key').fill(key);
    await opened.page.getByRole('button', { name: 'Sign in with the key' }).click();
    await opened.page.getByText('A job, after its end').waitFor();
    // The browser notes that it was asked to sign in.
    opened.faults.splice(0);
    return opened;
  };
  const accessible = async (page) => {
    for (const colorScheme of ['light', 'dark']) {
      await page.emulateMedia({ colorScheme });
      assert.deepEqual(await violations(page), []);
    }
  };
  const cloud = sample(folder(t), 'sphere', 300);
  const form = new FormData();
  form.append('file', new Blob([readFileSync(cloud)]), 'cloud.ply');
  form.append('job', JSON.stringify({ preset: 'fast', labels: { file: 'ball.ply' } }));
  const made = await fetch(`${origin}/v1/jobs`, { method: 'POST', body: form, headers: { authorization: `Bearer ${keys.maker}` } });
  const { id } = await made.json();

  const reader = await enter(keys.reader);
  for (const name of ['Keys', 'Audit trail', 'Work']) assert.equal(await reader.page.getByRole('heading', { name, exact: true }).count(), 0);
  await reader.page.getByText('7 days').or(reader.page.getByText('A week')).waitFor();
  await reader.page.goto(`${origin}/#/jobs/${id}`);
  await reader.page.getByText('Authorization: Bearer $MESHWAY_KEY').first().waitFor();
  for (const name of ['Cancel', 'Retry', 'Delete', 'Hold']) assert.equal(await reader.page.getByRole('button', { name }).count(), 0);
  assert.deepEqual(reader.faults, []);

  const { page, faults } = await enter(keys.maker);
  await page.getByRole('heading', { name: 'Work', exact: true }).waitFor();
  await page.getByText('Make a key').click();
  await page.getByLabel('Name, as the audit trail shall have it').fill('maker');
  assert.ok(await page.getByRole('checkbox', { name: /^audit/ }).isDisabled());
  await page.getByRole('button', { name: 'Make the key' }).click();
  await page.getByRole('alert').getByText('The tenant has a key maker already').waitFor();
  await page.getByLabel('Name, as the audit trail shall have it').fill('pacs');
  await page.getByRole('button', { name: 'Make the key' }).click();
  const key = await page.getByLabel('The key pacs', { exact: true }).textContent();
  const jobs = () => fetch(`${origin}/v1/jobs`, { headers: { authorization: `Bearer ${key}` } });
  assert.equal((await jobs()).status, 200);
  await accessible(page);
  await page.getByRole('button', { name: 'Take out pacs' }).click();
  await page.getByRole('dialog').getByRole('button', { name: 'Take out' }).click();
  await page.getByText('pacs is out of use.').waitFor();
  assert.equal((await jobs()).status, 401);
  assert.equal(await page.getByRole('heading', { name: 'Audit trail' }).count(), 0);
  assert.deepEqual(faults.filter((fault) => !fault.includes('409')), []);

  const auditor = await enter(keys.auditor);
  await auditor.page.getByRole('row', { name: /maker.*job\.create/ }).waitFor();
  await auditor.page.getByRole('row', { name: /maker.*key\.create/ }).waitFor();
  await accessible(auditor.page);
  await auditor.page.getByRole('row', { name: /job\.create/ }).getByRole('link').first().click();
  await auditor.page.getByRole('heading', { name: 'ball.ply' }).waitFor();
  assert.deepEqual(auditor.faults, []);
});
