// Writes what the dashboard knows of the contract: types for the compiler, and the settings with
// their bounds and descriptions for the form. With --check it only says whether they are current.

import { execFileSync } from 'node:child_process';
import { readFileSync, writeFileSync } from 'node:fs';
import { parse } from 'yaml';

const check = process.argv.includes('--check');
const contract = '../openapi.yaml';
const types = 'src/api/contract.d.ts';
const settings = 'src/api/settings.json';
const tool = 'node_modules/openapi-typescript/bin/cli.js';

const groups = parse(readFileSync(contract, 'utf8')).components.schemas.Settings.properties;
const rows = Object.entries(groups).flatMap(([group, { properties }]) =>
  Object.entries(properties).map(([name, { type, enum: options, minimum, maximum, description }]) =>
    ({ group, name, type, options, minimum, maximum, description })));
const text = `[\n${rows.map((row) => `  ${JSON.stringify(row)}`).join(',\n')}\n]\n`;

execFileSync(process.execPath, [tool, contract, '--output', types, ...(check ? ['--check'] : [])],
  { stdio: ['ignore', 'ignore', 'inherit'] });
if (!check) writeFileSync(settings, text);
else if (readFileSync(settings, 'utf8') !== text) {
  console.error(`${settings} is not that of openapi.yaml: run npm run types`);
  process.exit(1);
}
