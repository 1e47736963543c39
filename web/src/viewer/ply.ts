// Reads what the service writes: its binary PLY, and the points of a cloud.

import { answer } from '../api/client';

/** Triangles, with coordinates from `origin` on, where 32 bits have digits enough. */
export interface Mesh {
  origin: [number, number, number];
  positions: Float32Array;
  normals: Float32Array | null;
  /** Of each vertex from the nearest point of the cloud. */
  distances: Float32Array | null;
  /** Of each vertex from another mesh, where there is one beside it. */
  toOther?: Float32Array;
  index: Uint32Array;
}

/** Points, with coordinates from `origin` on; labels 0 surface, 1 inside, -1 outside. */
export interface Points {
  origin: [number, number, number];
  positions: Float32Array;
  labels: Float32Array;
}

const WIDTHS: Record<string, number> = { float: 4, double: 8 };

interface Header {
  vertices: number;
  faces: number;
  properties: { name: string; double: boolean; offset: number }[];
  stride: number;
  end: number;
}

function header(buffer: ArrayBuffer): Header {
  const head = new TextDecoder('latin1').decode(buffer.slice(0, 4096));
  const mark = 'end_header\n';
  const end = head.indexOf(mark) + mark.length;
  if (!head.startsWith('ply\nformat binary_little_endian') || end < mark.length) throw new Error('The mesh is no binary PLY file.');
  const found: Header = { vertices: 0, faces: 0, properties: [], stride: 0, end };
  let element = '';
  for (const line of head.slice(0, end).split('\n')) {
    const [word, first = '', second = ''] = line.split(' ');
    if (word === 'element') {
      element = first;
      if (first === 'vertex') found.vertices = Number(second);
      if (first === 'face') found.faces = Number(second);
    } else if (word === 'property' && element === 'vertex') {
      const width = WIDTHS[first];
      if (width === undefined) throw new Error(`The mesh has a property of type ${first}.`);
      found.properties.push({ name: second, double: width === 8, offset: found.stride });
      found.stride += width;
    }
  }
  return found;
}

export function parseMesh(buffer: ArrayBuffer): Mesh {
  const { vertices, faces, properties, stride, end } = header(buffer);
  const view = new DataView(buffer);
  const reader = (name: string) => {
    const property = properties.find((candidate) => candidate.name === name);
    if (!property) return null;
    return (vertex: number) => {
      const at = end + vertex * stride + property.offset;
      return property.double ? view.getFloat64(at, true) : view.getFloat32(at, true);
    };
  };
  const triples = (names: string[], origin: number[]) => {
    const readers = names.map(reader);
    if (readers.some((read) => read === null)) return null;
    const values = new Float32Array(vertices * 3);
    readers.forEach((read, axis) => {
      for (let i = 0; i < vertices; i += 1) values[3 * i + axis] = (read?.(i) ?? 0) - (origin[axis] ?? 0);
    });
    return values;
  };
  const origin = ['x', 'y', 'z'].map((name) => {
    const read = reader(name);
    let low = Infinity;
    let high = -Infinity;
    for (let i = 0; i < vertices; i += 1) {
      const value = read?.(i) ?? 0;
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
    return vertices > 0 ? (low + high) / 2 : 0;
  }) as [number, number, number];
  const distance = reader('distance_to_points');
  return {
    origin,
    positions: triples(['x', 'y', 'z'], origin) ?? new Float32Array(),
    normals: triples(['nx', 'ny', 'nz'], [0, 0, 0]),
    distances: distance && Float32Array.from({ length: vertices }, (_, i) => distance(i)),
    index: triangles(view, end + vertices * stride, faces),
  };
}

/** A byte with the number of corners, always three, and their indices. */
function triangles(view: DataView, start: number, faces: number): Uint32Array {
  const index = new Uint32Array(faces * 3);
  for (let face = 0, at = start; face < faces; face += 1, at += 13) {
    for (let corner = 0; corner < 3; corner += 1) index[3 * face + corner] = view.getUint32(at + 1 + 4 * corner, true);
  }
  return index;
}

export async function fetchMesh(path: string): Promise<Mesh> {
  return parseMesh(await (await answer(path)).arrayBuffer());
}

export async function fetchPoints(cloud: string): Promise<Points> {
  const response = await answer(`/v1/clouds/${cloud}/points?max=100000`);
  const origin = (response.headers.get('meshway-origin') ?? '0,0,0').split(',').map(Number) as [number, number, number];
  const rows = new Float32Array(await response.arrayBuffer());
  const total = rows.length / 4;
  const positions = new Float32Array(total * 3);
  const labels = new Float32Array(total);
  for (let i = 0; i < total; i += 1) {
    positions.set(rows.subarray(4 * i, 4 * i + 3), 3 * i);
    labels[i] = rows[4 * i + 3] ?? 0;
  }
  return { origin, positions, labels };
}
