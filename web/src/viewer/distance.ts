// How far the vertices of one mesh are from the surface of another: exactly, up to a distance from
// which on it does not matter. Triangles are sorted into the cells of a grid.

import type { Mesh } from './ply';

type Vector = [number, number, number];

/** Cells along the longest edge, at most. */
const MOST_CELLS = 96;

interface Grid {
  low: Vector;
  cell: number;
  counts: Vector;
  /** Triangles that touch each cell. */
  cells: Map<number, number[]>;
}

function corner(mesh: Mesh, triangle: number, which: number): Vector {
  const at = 3 * (mesh.index[3 * triangle + which] ?? 0);
  return [mesh.positions[at] ?? 0, mesh.positions[at + 1] ?? 0, mesh.positions[at + 2] ?? 0];
}

const place = (grid: Grid, value: number, axis: 0 | 1 | 2) => Math.floor((value - grid.low[axis]) / grid.cell);
const key = ({ counts }: Grid, x: number, y: number, z: number) => (z * counts[1] + y) * counts[0] + x;

function sorted(mesh: Mesh): Grid {
  const low: Vector = [Infinity, Infinity, Infinity];
  const high: Vector = [-Infinity, -Infinity, -Infinity];
  mesh.positions.forEach((value, i) => {
    const axis = (i % 3) as 0 | 1 | 2;
    low[axis] = Math.min(low[axis], value);
    high[axis] = Math.max(high[axis], value);
  });
  const triangles = mesh.index.length / 3;
  const longest = Math.max(high[0] - low[0], high[1] - low[1], high[2] - low[2], 1e-12);
  const cell = longest / Math.min(MOST_CELLS, Math.max(4, Math.sqrt(triangles / 4)));
  const counts = low.map((from, axis) => Math.floor(((high[axis] ?? 0) - from) / cell) + 1) as Vector;
  const grid: Grid = { low, cell, counts, cells: new Map() };
  for (let triangle = 0; triangle < triangles; triangle += 1) {
    const corners = [0, 1, 2].map((which) => corner(mesh, triangle, which));
    const range = (axis: 0 | 1 | 2) => {
      const values = corners.map((at) => place(grid, at[axis], axis));
      return [Math.min(...values), Math.max(...values)] as [number, number];
    };
    const [[x0, x1], [y0, y1], [z0, z1]] = [range(0), range(1), range(2)];
    for (let z = z0; z <= z1; z += 1) {
      for (let y = y0; y <= y1; y += 1) {
        for (let x = x0; x <= x1; x += 1) {
          const at = key(grid, x, y, z);
          const there = grid.cells.get(at);
          if (there) there.push(triangle);
          else grid.cells.set(at, [triangle]);
        }
      }
    }
  }
  return grid;
}

const minus = (a: Vector, b: Vector): Vector => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a: Vector, b: Vector) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** Square of the distance of a point from a triangle (Ericson, Real-Time Collision Detection, 5.1.5). */
function squared(p: Vector, a: Vector, b: Vector, c: Vector): number {
  const [ab, ac, ap] = [minus(b, a), minus(c, a), minus(p, a)];
  const at = (v: number, w: number) => {
    const d: Vector = [ap[0] - v * ab[0] - w * ac[0], ap[1] - v * ab[1] - w * ac[1], ap[2] - v * ab[2] - w * ac[2]];
    return dot(d, d);
  };
  const [d1, d2] = [dot(ab, ap), dot(ac, ap)];
  if (d1 <= 0 && d2 <= 0) return at(0, 0);
  const bp = minus(p, b);
  const [d3, d4] = [dot(ab, bp), dot(ac, bp)];
  if (d3 >= 0 && d4 <= d3) return at(1, 0);
  const vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return at(d1 / (d1 - d3), 0);
  const cp = minus(p, c);
  const [d5, d6] = [dot(ab, cp), dot(ac, cp)];
  if (d6 >= 0 && d5 <= d6) return at(0, 1);
  const vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return at(0, d2 / (d2 - d6));
  const va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) {
    const w = (d4 - d3) / (d4 - d3 + (d5 - d6));
    return at(1 - w, w);
  }
  const sum = va + vb + vc;
  return sum === 0 ? at(0, 0) : at(vb / sum, vc / sum);
}

/** Distance of each vertex of `from` to the surface `to`, at most `most`. */
export function distances(from: Mesh, to: Mesh, most: number): Float32Array {
  const grid = sorted(to);
  const shift = minus(from.origin, to.origin);
  const found = new Float32Array(from.positions.length / 3);
  const reach = Math.ceil(most / grid.cell);
  for (let i = 0; i < found.length; i += 1) {
    const p: Vector = [0, 1, 2].map((axis) => (from.positions[3 * i + axis] ?? 0) + (shift[axis] ?? 0)) as Vector;
    found[i] = nearest(grid, to, p, reach, most);
  }
  return found;
}

/** Looks into the cells around the point, shell by shell, until no further one can be nearer. */
function nearest(grid: Grid, to: Mesh, p: Vector, reach: number, most: number): number {
  const middle = [place(grid, p[0], 0), place(grid, p[1], 1), place(grid, p[2], 2)] as const;
  let best = most * most;
  for (let shell = 0; shell <= reach + 1; shell += 1) {
    // What is in this shell is at least so far away.
    const least = (shell - 1) * grid.cell;
    if (least > 0 && least * least >= best) break;
    for (let z = Math.max(0, middle[2] - shell); z <= Math.min(grid.counts[2] - 1, middle[2] + shell); z += 1) {
      for (let y = Math.max(0, middle[1] - shell); y <= Math.min(grid.counts[1] - 1, middle[1] + shell); y += 1) {
        const inside = Math.abs(z - middle[2]) < shell && Math.abs(y - middle[1]) < shell;
        const step = inside ? Math.max(1, 2 * shell) : 1;
        for (let x = middle[0] - shell; x <= middle[0] + shell; x += step) {
          if (x < 0 || x >= grid.counts[0]) continue;
          for (const triangle of grid.cells.get(key(grid, x, y, z)) ?? []) {
            best = Math.min(best, squared(p, corner(to, triangle, 0), corner(to, triangle, 1), corner(to, triangle, 2)));
          }
        }
      }
    }
  }
  return Math.sqrt(best);
}
