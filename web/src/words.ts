// What the names of the API are called here.

import type { Phase, PresetName, Status, Verdict } from './api/types';

export const STATUS: Record<Status, string> = {
  queued: 'Queued',
  running: 'Running',
  succeeded: 'Succeeded',
  failed: 'Failed',
  cancelled: 'Cancelled',
};

export const VERDICT: Record<Verdict, string> = { good: 'Good', doubtful: 'Doubtful', poor: 'Poor' };

export const VERDICT_MEANS: Record<Verdict, string> = {
  good: 'The mesh agrees with its points.',
  doubtful: 'Look at the reasons before you rely on the mesh.',
  poor: 'The mesh is likely wrong. Do not rely on it without checking it by other means.',
};

export const PHASES: Phase[] = ['sampling', 'training', 'surface', 'report'];

export const PHASE: Record<Phase, string> = {
  sampling: 'Prepare points',
  training: 'Train',
  surface: 'Extract surface',
  report: 'Check mesh',
};

export const PRESETS: { name: PresetName; title: string; text: string }[] = [
  { name: 'fast', title: 'Fast', text: 'A first look, in seconds.' },
  { name: 'balanced', title: 'Balanced', text: 'Right for most clouds.' },
  { name: 'fine', title: 'Fine', text: 'More detail, more time.' },
  { name: 'paper', title: 'Paper', text: 'The runs of the publication.' },
];

/** The settings that the form shows first, in its order: what they are called and do, in short. */
export const COMMON: Record<string, { title: string; text: string }> = {
  'training.max_evaluations': { title: 'Training steps', text: 'At most; training ends by itself when it no longer helps.' },
  'surface.resolution': { title: 'Grid resolution', text: 'Grid points along the longest edge, at most.' },
  'surface.target_triangles': { title: 'Simplify to triangles', text: 'As far as the points allow. 0 keeps all.' },
  'surface.open': { title: 'Where no points are near', text: 'Whether the surface is closed there or cut away.' },
  'training.smoothing': { title: 'Smoothing', text: '1 follows the noise of the points, more is smoother, 0 is none.' },
  'sampling.surface_points': { title: 'Points trained on', text: 'At most; the others test the result.' },
  'network.scheme': { title: 'Residual scheme', text: 'How the layers of the network are connected.' },
  'network.width': { title: 'Neurons per layer', text: 'More can show finer detail, and take longer.' },
  'network.hidden_layers': { title: 'Hidden layers', text: 'Depth of the network.' },
  'training.seed': { title: 'Random seed', text: 'The same seed gives the same mesh.' },
};

/** Choices whose names say little. */
export const CHOICES: Record<string, Record<string, string>> = {
  'surface.open': { auto: 'Let the points decide', closed: 'Stay closed', trimmed: 'Cut away' },
  'network.scheme': {
    plain: 'plain', resnet: 'resnet', highway: 'highway', hw: 'hw: simple highway', sqrhw: 'sqrhw: square highway', gated: 'gated',
  },
};

export const FORMATS: { name: string; text: string }[] = [
  { name: 'stl', text: 'printing, most CAD programs' },
  { name: 'ply', text: 'with normals and distances' },
  { name: 'obj', text: 'most 3D programs' },
  { name: 'glb', text: 'web and viewers' },
  { name: 'off', text: 'geometry libraries' },
  { name: '3mf', text: 'printing, with its unit' },
  { name: 'vtp', text: 'ParaView and VTK, with distances' },
];

/** Formats that can have colours. */
export const COLOURED = ['ply', 'glb'];
