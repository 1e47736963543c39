// Distances between meshes against those between spheres, and against a search through everything.

import assert from 'node:assert/strict';
import { dirname } from 'node:path';
import { test } from 'node:test';
import { fileURLToPath } from 'node:url';
import { build } from 'esbuild';

const absWorkingDir = dirname(dirname(fileURLToPath(import.meta.url)));
const { outputFiles: [script] } = await build({
  absWorkingDir, entryPoints: ['src/viewer/distance.ts'], bundle: true, format: 'esm', write: false,
});
const { distances } = await import(`data:text/javascript;base64,${Buffer.from(script.contents).toString('base64')}`);

/** A ball of so many rings; its triangles lie a little inside. */
function ball(radius, rings, origin = [0, 0, 0]) {
  const positions = [];
  const index = [];
  const sides = 2 * rings;
  for (let ring = 0; ring <= rings; ring += 1) {
    for (let side = 0; side < sides; side += 1) {
      const [polar, turn] = [(Math.PI * ring) / rings, (2 * Math.PI * side) / sides];
      positions.push(radius * Math.sin(polar) * Math.cos(turn), radius * Math.sin(polar) * Math.sin(turn), radius * Math.cos(polar));
      if (ring === rings) continue;
      const [a, b] = [ring * sides + side, ring * sides + ((side + 1) % sides)];
      index.push(a, a + sides, b, b, a + sides, b + sides);
    }
  }
  return { origin, positions: Float32Array.from(positions), normals: null, distances: null, index: Uint32Array.from(index) };
}

test('balls in each other are as far apart as their radii differ', () => {
  const rings = 48;
  // The middle of a side of the outer ball lies so much inside.
  const sag = 1.2 * (1 - Math.cos(Math.PI / rings / Math.SQRT2)) * 2;
  for (const distance of distances(ball(1, rings), ball(1.2, rings), 1)) {
    assert.ok(distance > 0.2 - sag && distance <= 0.2 + 1e-6, `${distance}`);
  }
});

test('the origins of the meshes count', () => {
  for (const distance of distances(ball(1, 12, [5e6, 0, 0]), ball(1, 12, [5e6, 0, 0]), 1)) assert.ok(distance < 1e-6);
  const moved = distances(ball(0.01, 6, [3, 0, 0]), ball(1, 48), 5);
  for (const distance of moved) assert.ok(Math.abs(distance - 2) < 0.02, `${distance}`);
});

test('what is further than the most is as far as that', () => {
  for (const distance of distances(ball(0.01, 6, [3, 0, 0]), ball(1, 12), 0.5)) assert.equal(distance, 0.5);
});
