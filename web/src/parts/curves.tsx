// The training of a job as curves.

import { useEffect, useMemo, useState } from 'preact/hooks';
import { get, words } from '../api/client';
import type { BlockSeries, GradientHistogram, Job } from '../api/types';
import { losses, norms, useCurves, type Curves } from '../state/curves';
import { active } from '../state/jobs';
import { many } from '../format';
import { Panel, Trouble } from './basic';
import { Chart, type Curve } from './chart';

type Choice = 'loss' | 'gradient' | 'weights' | 'blocks';

const CHOICES: Record<Choice, string> = { loss: 'Loss', gradient: 'Gradient norm', weights: 'Weight norms', blocks: 'Each block' };

const COLORS = ['curve-1', 'curve-2', 'curve-3', 'curve-4'];

/** The norms of the weights, a curve each layer. */
export function ofLayers(curves: Curves): Curve[] {
  // There are more layers than colours that differ: the dashed ones are those of the second round.
  return norms(curves).map((curve, i) => ({
    label: `Layer ${i + 1}`, color: COLORS[i % COLORS.length] ?? 'curve-1', dashed: i >= COLORS.length, ...curve,
  }));
}

function drawn(curves: Curves, choice: Choice): Curve[] {
  const x = curves.evaluation;
  if (choice === 'gradient') return [{ label: 'Gradient norm', color: 'curve-1', x, y: curves.gradient_norm }];
  if (choice === 'weights') return ofLayers(curves);
  const all: Curve[] = [{ label: 'Loss', color: 'curve-1', ...losses(curves, false) }];
  if (curves.validation_loss.some((value) => value !== null)) {
    all.push({ label: 'Validation loss', color: 'curve-2', dashed: true, x, y: curves.validation_loss });
  }
  const blocks = losses(curves, true);
  if (blocks.x.length > 0) all.push({ label: 'Loss of blocks, mean', color: 'curve-4', ...blocks });
  return all;
}

export function CurvesPanel({ job }: { job: Job }) {
  const curves = useCurves(job.id, job.status);
  const [log, setLog] = useState(true);
  const [choice, setChoice] = useState<Choice>('loss');
  const shown = useMemo(() => drawn(curves, choice), [curves, choice]);
  const controls = (
    <span class="inline">
      <label class="inline">Curve
        <select value={choice} onChange={({ currentTarget: { value } }) => setChoice(value as Choice)}>
          {Object.entries(CHOICES).map(([value, text]) => <option value={value}>{text}</option>)}
        </select>
      </label>
      <label class="check"><input type="checkbox" checked={log} onChange={({ currentTarget }) => setLog(currentTarget.checked)} /> Log scale</label>
    </span>
  );
  return (
    <Panel title="Training" aside={controls}>
      {choice === 'blocks' ? <Blocks job={job} log={log} /> : curves.evaluation.length > 0
        ? <Chart curves={shown} log={log} xLabel="Evaluations" />
        : <p class="muted">{active(job.status) ? 'Curves appear when training begins.' : 'There are no curves.'}</p>}
      <Gradients job={job} />
    </Panel>
  );
}

/** What the numbers of blocks are called, in the order in which they are drawn. */
const QUANTITIES: { name: 'first_loss' | 'loss' | 'held_out_error'; label: string; color: string }[] = [
  { name: 'first_loss', label: 'Loss after the first step', color: 'curve-4' },
  { name: 'loss', label: 'Loss at the end', color: 'curve-1' },
  { name: 'held_out_error', label: 'Distance of points held out', color: 'curve-2' },
];

/** The blocks of a job beside each other, asked for when they are chosen. */
function Blocks({ job, log }: { job: Job; log: boolean }) {
  const [found, setFound] = useState<BlockSeries | null>(null);
  const [trouble, setTrouble] = useState('');
  useEffect(() => {
    get<BlockSeries>(`/v1/jobs/${job.id}/metrics?blocks=true`).then(setFound, (error: unknown) => setTrouble(words(error)));
  }, [job.id, job.status]);
  const shown = useMemo(() => QUANTITIES.flatMap(({ name, label, color }): Curve[] => {
    const y = found?.series[name] ?? [];
    return y.some((value) => value !== null) ? [{ label, color, dots: true, x: y.map((_, i) => i + 1), y }] : [];
  }), [found]);
  if (trouble) return <Trouble>{trouble}</Trouble>;
  if (!found) return <p class="muted" role="status">Loading…</p>;
  if (shown.length === 0) {
    return <p class="muted">{active(job.status) ? 'The numbers of each block appear when the job has succeeded.' : 'The cloud was not cut into blocks.'}</p>;
  }
  return (
    <>
      <Chart curves={shown} log={log} xLabel="Block" />
      <p class="help">{ended(found)}</p>
    </>
  );
}

/** How many blocks there are, and why their trainings ended. */
function ended({ blocks, series: { termination = [] } }: BlockSeries): string {
  const counts = new Map<string, number>();
  for (const why of termination) counts.set(why, (counts.get(why) ?? 0) + 1);
  const reasons = [...counts].sort((a, b) => b[1] - a[1]).map(([why, count]) => `${why.replaceAll('_', ' ')} ${count}`);
  return `${many(blocks, 'block')}. Their trainings ended by: ${reasons.join(', ')}.`;
}

/** The places of the bins' middles, and how many components of the gradient each has. */
function histogram({ layer, min, max, counts }: GradientHistogram['layers'][number], i: number): Curve {
  const width = (max - min) / counts.length;
  return {
    label: layer, color: COLORS[i % COLORS.length] ?? 'curve-1', dashed: i >= COLORS.length,
    x: counts.map((_, bin) => min + (bin + 0.5) * width), y: counts,
  };
}

/** Histograms of the gradient at chosen evaluations, where the settings ask for them. */
export function Gradients({ job }: { job: Job }) {
  const [items, setItems] = useState<GradientHistogram[]>([]);
  const [chosen, setChosen] = useState(0);
  const wanted = (job.settings.training?.histogram_evaluations ?? []).length > 0;
  useEffect(() => {
    if (wanted) get<{ items: GradientHistogram[] }>(`/v1/jobs/${job.id}/gradients`).then((page) => setItems(page.items), () => undefined);
  }, [job.id, job.status, wanted]);
  const shown = items[chosen];
  const drawn = useMemo(() => (shown?.layers ?? []).map(histogram), [shown]);
  if (!shown) return null;
  return (
    <>
      <label class="inline">Components of the gradient by layer, at evaluation
        <select value={String(chosen)} onChange={({ currentTarget: { value } }) => setChosen(Number(value))}>
          {items.map(({ evaluation }, i) => <option value={String(i)}>{evaluation}</option>)}
        </select>
      </label>
      <Chart curves={drawn} log={false} xLabel="Gradient" />
    </>
  );
}
