// A service with keys: the page asks for one, keeps it where no script reads it, and forgets it when asked to.

import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { test } from 'node:test';
import { browse, folder, open, program, serve, shared, violations } from './support.mjs';

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
