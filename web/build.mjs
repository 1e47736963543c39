// Builds the dashboard into dist/: every file gzipped, named by its content, and a stamp of what it
// was made from. build.rs puts them into the program.

import { existsSync, readFileSync, readdirSync, rmSync, statSync, writeFileSync } from 'node:fs';
import { basename, dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { gzipSync } from 'node:zlib';

const root = dirname(dirname(fileURLToPath(import.meta.url)));
const dist = join(root, 'web/dist');

// SOURCES in build.rs says the same.
const sources = ['web/build.mjs', 'web/package-lock.json', 'web/src'];

// Gzipped bytes: of what the first page needs, and of everything.
const MOST_FIRST = 60_000;
const MOST_ALL = 220_000;

function files(path) {
  if (!statSync(join(root, path)).isDirectory()) return [path];
  return readdirSync(join(root, path)).sort().flatMap((name) => files(`${path}/${name}`));
}

// FNV-1a of names and contents, as in build.rs.
function stamp() {
  let hash = 0xcbf29ce484222325n;
  const add = (bytes) => {
    for (const byte of bytes) hash = BigInt.asUintN(64, (hash ^ BigInt(byte)) * 0x100000001b3n);
  };
  for (const path of sources.flatMap(files)) {
    add(Buffer.from(path));
    add(readFileSync(join(root, path)));
  }
  return hash.toString(16).padStart(16, '0');
}

if (existsSync(join(dist, 'stamp')) && readFileSync(join(dist, 'stamp'), 'utf8') === stamp()) {
  // Written again it would look new to cargo.
  console.log('web/dist is current');
  process.exit(0);
}
const { build } = await import('esbuild');
const result = await build({
  absWorkingDir: join(root, 'web'),
  entryPoints: { main: 'src/main.tsx', style: 'src/style.css', icon: 'src/icon.svg' },
  bundle: true,
  splitting: true,
  format: 'esm',
  minify: true,
  write: false,
  metafile: true,
  outdir: 'dist',
  entryNames: '[name]-[hash]',
  chunkNames: '[name]-[hash]',
  assetNames: '[name]-[hash]',
  loader: { '.svg': 'copy' },
  target: ['chrome123', 'firefox120', 'safari17.5'],
  jsx: 'automatic',
  jsxImportSource: 'preact',
  legalComments: 'none',
  define: { 'process.env.NODE_ENV': '"production"' },
});

// The page names what it needs first: the script, what that imports at once, the style, the icon.
const outputs = result.metafile.outputs;
const entry = (name) => Object.keys(outputs).find((path) => basename(path).startsWith(`${name}-`));
const first = new Set();
const need = (path) => {
  if (first.has(path)) return;
  first.add(path);
  for (const { path: next, kind } of outputs[path].imports) {
    if (kind === 'import-statement') need(next);
  }
};
need(entry('main'));
const preloads = [...first].slice(1).map((path) => `<link rel="modulepreload" href="/assets/${basename(path)}">`);
first.add(entry('style')).add(entry('icon'));
const address = (name) => `/assets/${basename(entry(name))}`;
const page = readFileSync(join(root, 'web/src/index.html'), 'utf8')
  .replace('{style}', address('style'))
  .replace('{icon}', address('icon'))
  .replace('{main}', address('main'))
  .replace('{preloads}', preloads.join(''));

for (const name of readdirSync(dist)) if (name !== '.gitignore') rmSync(join(dist, name));
const sizes = new Map();
const keep = (name, content) => {
  const packed = gzipSync(content, { level: 9 });
  sizes.set(name, packed.length);
  writeFileSync(join(dist, `${name}.gz`), packed);
};
keep('index.html', page);
for (const { path, contents } of result.outputFiles) keep(basename(path), contents);

const sum = (names) => names.reduce((total, name) => total + sizes.get(name), 0);
const firstBytes = sum(['index.html', ...[...first].map((path) => basename(path))]);
const allBytes = sum([...sizes.keys()]);
for (const [name, bytes] of [...sizes].sort((a, b) => b[1] - a[1])) console.log(`${bytes}`.padStart(8), name);
console.log(`first page ${firstBytes} bytes gzipped, everything ${allBytes}`);
if (firstBytes > MOST_FIRST || allBytes > MOST_ALL) {
  console.error(`more than ${MOST_FIRST} or ${MOST_ALL}`);
  process.exit(1);
}
// Last: a build that broke off has no stamp.
writeFileSync(join(dist, 'stamp'), stamp());
