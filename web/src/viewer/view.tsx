// The 3D view: the picture, what can be shown in it, and what was picked. What draws is loaded when
// the first picture is.

import { useEffect, useId, useMemo, useRef, useState } from 'preact/hooks';
import { many, measure } from '../format';
import { words } from '../api/client';
import type { Frame, Unit } from '../api/types';
import { say } from '../parts/say';
import { color, repaint } from '../state/theme';
import { cividis } from './colormap';
import type { Mesh, Points } from './ply';
import type { Direction, Look, Palette, Scene, Triple } from './scene';

interface Props {
  name: string;
  mesh: Mesh | null;
  points: Points | null;
  /** Distance that is given the last colour at first. */
  scale: number | null;
  /** The same for distances to another mesh, which are the colours at first where there are any. */
  apart?: number | null;
  /** How the coordinates lie in a patient, and what a length of 1 is, where that is known. */
  frame?: Frame | null | undefined;
  unit?: Unit | null | undefined;
  /** Told of the picture, for those that turn it together with another. */
  onScene?: (scene: Scene | null) => void;
  origin?: Triple | null;
  compact?: boolean;
}

/** The sides, and their letters in the frame of a patient. */
const VIEWS: { direction: Direction; text: string; letter?: string }[] = [
  { direction: 'corner', text: 'All' }, { direction: 'front', text: 'Front', letter: 'A' }, { direction: 'back', text: 'Back', letter: 'P' },
  { direction: 'left', text: 'Left', letter: 'L' }, { direction: 'right', text: 'Right', letter: 'R' }, { direction: 'top', text: 'Top', letter: 'S' },
  { direction: 'bottom', text: 'Bottom', letter: 'I' },
];

/** Planes across each axis, and what they are called in the frame of a patient. */
const CUTS = { x: 'sagittal', y: 'coronal', z: 'axial' };

const ofPatient = (frame: Frame | null | undefined) => frame === 'lps' || frame === 'ras';

const COLORS = { points: 'Distance to points', other: 'Distance to the other mesh' };

const START: Look = {
  mesh: true, points: true, wireframe: false, color: '', most: 1, cut: '', cutAt: 0.5,
};

function palette(): Palette {
  return {
    background: color('canvas'), surface: color('mesh'), points: color('points'), inside: color('inside'),
    outside: color('outside'), pick: color('pick'), letters: color('text'),
  };
}

export function View({ name, mesh, points, scale, apart, frame, unit, onScene, origin, compact }: Props) {
  const box = useRef<HTMLDivElement>(null);
  const scene = useRef<Scene | null>(null);
  const help = useId();
  const [drawn, setDrawn] = useState(false);
  const [look, setLook] = useState<Look>(apart ? { ...START, points: false, color: 'other', most: apart } : START);
  const paints = useMemo(palette, [repaint.value]);
  const [picks, setPicks] = useState<Triple[]>([]);
  const [trouble, setTrouble] = useState('');
  const change = (next: Partial<Look>) => setLook((old) => ({ ...old, ...next }));

  useEffect(() => {
    let gone = false;
    import('./scene').then(({ Scene: Drawn }) => {
      if (gone || !box.current) return;
      const made = new Drawn(box.current, origin ?? null);
      made.onPick = setPicks;
      made.onLost = (lost) => setTrouble(lost ? 'The graphics card took the picture away; it comes back by itself.' : '');
      scene.current = made;
      onScene?.(made);
      setDrawn(true);
    }).catch((error: unknown) => setTrouble(`The picture cannot be drawn: ${words(error)}`));
    return () => {
      gone = true;
      scene.current?.dispose();
      scene.current = null;
      onScene?.(null);
    };
  }, []);
  useEffect(() => { scene.current?.setFrame(frame ?? null); }, [drawn, frame]);
  useEffect(() => { scene.current?.setPoints(points); }, [drawn, points]);
  useEffect(() => { scene.current?.setMesh(mesh); }, [drawn, mesh]);
  useEffect(() => { if (scale && !apart) change({ most: scale }); }, [scale]);
  useEffect(() => { scene.current?.show(look, paints); }, [drawn, look, paints]);

  const keys = (event: KeyboardEvent) => {
    const moves: Record<string, () => void> = {
      ArrowLeft: () => scene.current?.turn(-1, 0),
      ArrowRight: () => scene.current?.turn(1, 0),
      ArrowUp: () => scene.current?.turn(0, 1),
      ArrowDown: () => scene.current?.turn(0, -1),
      '+': () => scene.current?.zoom(0.87),
      '-': () => scene.current?.zoom(1.15),
      Home: () => scene.current?.view('corner'),
      Enter: () => scene.current?.pick(),
      Escape: () => scene.current?.clearPicks(),
    };
    const move = moves[event.key];
    if (!move) return;
    event.preventDefault();
    move();
  };
  const label = `${name}: ${mesh ? many(mesh.index.length / 3, 'triangle') : 'no mesh yet'}, ${points ? many(points.labels.length, 'point') : 'no points'}`;
  return (
    <div class="view">
      <div class="picture-frame">
        <div ref={box} class={compact ? 'picture compact' : 'picture'} role="application" tabIndex={0} aria-label={label}
          aria-roledescription="3D view" aria-describedby={help} onKeyDown={keys} />
        {!mesh && !points && !trouble && <p class="picture-note" role="status">Loading…</p>}
        {trouble && <p class="picture-note" role="alert">{trouble}</p>}
        {look.color && mesh && look.mesh && <Legend of={COLORS[look.color]} most={look.most} unit={unit} />}
      </div>
      <p id={help} class="unseen">Arrow keys turn, plus and minus zoom, Home shows all, Enter picks the middle, Escape clears the picks.</p>
      <Controls {...{ look, mesh, points, scale, apart, frame, unit, change }} />
      <div class="buttons" role="group" aria-label="Views">
        {VIEWS.map(({ direction, text, letter }) => (
          <button type="button" class="small" onClick={() => scene.current?.view(direction)}>{text}{letter && ofPatient(frame) && ` ${letter}`}</button>
        ))}
        <button type="button" class="small" onClick={() => void save(scene.current, name)}>Save picture</button>
      </div>
      <Picks picks={picks} unit={unit} clear={() => scene.current?.clearPicks()} />
    </div>
  );
}

async function save(scene: Scene | null, name: string): Promise<void> {
  const picture = await scene?.picture();
  if (!picture) return;
  const link = document.createElement('a');
  link.href = URL.createObjectURL(picture);
  link.download = `${name.replace(/[^\w.-]+/g, '-')}.png`;
  link.click();
  URL.revokeObjectURL(link.href);
  say('The picture is saved.');
}

interface ControlProps {
  look: Look;
  mesh: Mesh | null;
  points: Points | null;
  scale: number | null;
  apart: number | null | undefined;
  frame: Frame | null | undefined;
  unit: Props['unit'];
  change: (look: Partial<Look>) => void;
}

function Controls({ look, mesh, points, scale, apart, frame, unit, change }: ControlProps) {
  const check = (text: string, key: 'mesh' | 'points' | 'wireframe', off: boolean) => (
    <label class="check">
      <input type="checkbox" checked={look[key]} disabled={off} onChange={({ currentTarget }) => change({ [key]: currentTarget.checked })} />
      {text}
    </label>
  );
  const usual = (of: Look['color']) => (of === 'other' ? apart : scale) ?? look.most;
  const far = 3 * usual(look.color);
  return (
    <div class="controls">
      {check('Mesh', 'mesh', !mesh)}
      {check('Points', 'points', !points?.labels.length)}
      {check('Wireframe', 'wireframe', !mesh)}
      <label>Colour
        <select value={look.color} disabled={!mesh} onChange={({ currentTarget }) => {
          const next = currentTarget.value as Look['color'];
          change({ color: next, most: usual(next) });
        }}>
          <option value="">Plain</option>
          {mesh?.distances && <option value="points">{COLORS.points}</option>}
          {mesh?.toOther && <option value="other">{COLORS.other}</option>}
        </select>
      </label>
      {look.color && (
        <label>Up to {measure(look.most, unit)}
          <input type="range" min={far / 100} max={far} step={far / 100} value={look.most}
            onInput={({ currentTarget }) => change({ most: Number(currentTarget.value) })} />
        </label>
      )}
      <label>Cut
        <select value={look.cut} onChange={({ currentTarget: { value } }) => change({ cut: value as Look['cut'] })}>
          <option value="">Nowhere</option>
          {Object.entries(CUTS).map(([axis, plane]) => <option value={axis}>Across {axis}{ofPatient(frame) && `, ${plane}`}</option>)}
        </select>
      </label>
      {look.cut && (
        <label>At {Math.round(look.cutAt * 100)} %
          <input type="range" min={0} max={1} step={0.01} value={look.cutAt}
            onInput={({ currentTarget }) => change({ cutAt: Number(currentTarget.value) })} />
        </label>
      )}
    </div>
  );
}

function Legend({ of, most, unit }: { of: string; most: number; unit: Props['unit'] }) {
  const bar = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const context = bar.current?.getContext('2d');
    for (let x = 0; context && x < 128; x += 1) {
      const [r, g, b] = cividis(x / 127).map((channel) => Math.round(channel * 255));
      context.fillStyle = `rgb(${r},${g},${b})`;
      context.fillRect(x, 0, 1, 1);
    }
  }, []);
  return (
    <div class="legend">
      <span>{of}</span>
      <canvas ref={bar} width={128} height={1} aria-hidden="true" />
      <span class="ends"><span>0</span><span>{measure(most, unit)} and more</span></span>
    </div>
  );
}

function Picks({ picks, unit, clear }: { picks: Triple[]; unit: Props['unit']; clear: () => void }) {
  const text = (at: Triple) => at.map((value) => Number(value.toPrecision(7)).toString()).join(', ');
  const [first, second] = picks;
  return (
    <p class="picks" role="status">
      {!first && 'Drag to turn, then scroll to zoom. A click reads the coordinates of a place, a second one the distance.'}
      {first && <>Place <code>{text(first)}</code></>}
      {first && second && <> to <code>{text(second)}</code>, distance <strong>{measure(Math.hypot(...first.map((x, i) => x - (second[i] ?? 0))), unit)}</strong></>}
      {first && <> <button type="button" class="small plain" onClick={clear}>Clear</button></>}
    </p>
  );
}
