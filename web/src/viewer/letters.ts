// Where the sides of a patient are: letters around the picture, and what each view looks from.

import { CanvasTexture, Group, Sprite, SpriteMaterial, SRGBColorSpace, Vector3 } from 'three';
import type { Frame } from '../api/types';
import type { Direction, Triple } from './scene';

/** From where each view looks; z is up. */
const PLAIN: Record<Direction, Triple> = {
  front: [0, -1, 0], back: [0, 1, 0], left: [-1, 0, 0], right: [1, 0, 0], top: [0, -1e-3, 1], bottom: [0, -1e-3, -1], corner: [0.9, -1.2, 0.7],
};

/** The same in LPS, where x leads to the patient's left and y to the back; from above and below the front is up. */
const OF_PATIENT: Record<Direction, Triple> = { ...PLAIN, left: [1, 0, 0], right: [-1, 0, 0], top: [0, 1e-3, 1], bottom: [0, 1e-3, -1] };

export function direction(frame: Frame | null, name: Direction): Triple {
  if (frame !== 'lps' && frame !== 'ras') return PLAIN[name];
  const [x, y, z] = OF_PATIENT[name];
  return frame === 'lps' ? [x, y, z] : [-x, -y, z];
}

/** Each letter with the view that looks from its side. */
const LETTERS: [letter: string, side: Direction][] = [
  ['L', 'left'], ['R', 'right'], ['A', 'front'], ['P', 'back'], ['S', 'top'], ['I', 'bottom'],
];

/** Height of a letter at a distance of 1. */
const SIZE = 0.045;

function drawn(letter: string, [color, halo]: [string, string]): CanvasTexture {
  const canvas = document.createElement('canvas');
  canvas.width = canvas.height = 64;
  const context = canvas.getContext('2d');
  if (context) {
    context.font = '700 52px system-ui, sans-serif';
    context.textAlign = 'center';
    context.textBaseline = 'middle';
    // It stands before the surface as well as beside it.
    context.lineJoin = 'round';
    context.lineWidth = 8;
    context.strokeStyle = halo;
    context.strokeText(letter, 32, 35);
    context.fillStyle = color;
    context.fillText(letter, 32, 35);
  }
  const texture = new CanvasTexture(canvas);
  texture.colorSpace = SRGBColorSpace;
  return texture;
}

export class Letters extends Group {
  /** Around a box, in a colour with one around it; none where the frame is no patient's. */
  show(frame: Frame | null, [low, high]: [Vector3, Vector3], colors: [string, string]): void {
    this.dispose();
    if (frame !== 'lps' && frame !== 'ras') return;
    const middle = low.clone().add(high).multiplyScalar(0.5);
    const half = high.clone().sub(low).multiplyScalar(0.5);
    const margin = half.length() * 0.16;
    for (const [letter, side] of LETTERS) {
      const sprite = new Sprite(new SpriteMaterial({ map: drawn(letter, colors), sizeAttenuation: false, transparent: true }));
      const away = new Vector3(...direction(frame, side)).round();
      sprite.position.copy(middle).add(away.clone().multiply(half)).addScaledVector(away, margin);
      sprite.scale.setScalar(SIZE);
      this.add(sprite);
    }
  }

  dispose(): void {
    for (const sprite of this.children as Sprite[]) {
      sprite.material.map?.dispose();
      sprite.material.dispose();
    }
    this.clear();
  }
}
