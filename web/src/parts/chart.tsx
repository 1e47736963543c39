// Curves. What draws them is loaded with the first one.

import { useEffect, useRef } from 'preact/hooks';
import { number } from '../format';
import { color, repaint } from '../state/theme';

export interface Curve {
  label: string;
  /** Name of its colour in the style sheet. */
  color: string;
  dashed?: boolean;
  /** Whether its values belong to things of their own: dots in place of a line. */
  dots?: boolean;
  x: number[];
  y: (number | null)[];
}

interface Props {
  curves: Curve[];
  log: boolean;
  xLabel: string;
}

/** Steps of an axis that counts. */
const WHOLE = [1, 10, 100, 1000, 10_000, 100_000].flatMap((power) => [power, 2 * power, 5 * power]);

/** All curves over the places that any of them has. */
function table(curves: Curve[], log: boolean): (number | null)[][] {
  const xs = [...new Set(curves.flatMap((curve) => curve.x))].sort((a, b) => a - b);
  const place = new Map(xs.map((x, i) => [x, i]));
  const columns = curves.map(({ x, y }) => {
    const column = new Array<number | null | undefined>(xs.length).fill(undefined);
    x.forEach((at, i) => {
      const value = y[i] ?? null;
      // A logarithm has no zero.
      column[place.get(at) ?? 0] = log && value !== null && value <= 0 ? null : value;
    });
    return column as (number | null)[];
  });
  return [xs, ...columns];
}

function said({ label, y, dots }: Curve): string {
  const values = y.filter((value): value is number => value !== null);
  if (dots && values.length > 0) {
    const [least, most] = [Math.min, Math.max].map((of) => values.reduce((a, b) => of(a, b)));
    return `${label} between ${number(least)} and ${number(most)}`;
  }
  return values.length === 0 ? `${label}: no values yet` : `${label} from ${number(values[0])} to ${number(values.at(-1))}`;
}

export function Chart({ curves, log, xLabel }: Props) {
  const box = useRef<HTMLDivElement>(null);
  const chart = useRef<import('uplot') | null>(null);
  const shape = JSON.stringify([curves.map(({ label }) => label), log, repaint.value]);
  const data = useRef<(number | null)[][]>([]);
  data.current = table(curves, log);
  useEffect(() => {
    let gone = false;
    let resize: ResizeObserver | null = null;
    void import('uplot').then(({ default: UPlot }) => {
      const parent = box.current;
      if (gone || !parent) return;
      const axis = { stroke: color('muted'), grid: { stroke: color('grid'), width: 1 }, ticks: { stroke: color('grid'), width: 1 } };
      const size = () => ({ width: Math.max(200, parent.clientWidth), height: 240 });
      const made = new UPlot({
        ...size(),
        scales: { x: { time: false }, y: { distr: log ? 3 : 1 } },
        axes: [
          { ...axis, label: xLabel, labelSize: 22, size: 36, ...(data.current[0]?.every(Number.isInteger) ? { incrs: WHOLE } : {}) },
          { ...axis, size: 64, values: (_, splits) => splits.map((value) => (value === null ? '' : number(value))) },
        ],
        series: [
          { label: xLabel },
          ...curves.map((curve) => ({
            label: curve.label, stroke: color(curve.color), width: 2, spanGaps: true, points: { show: false },
            ...(curve.dots ? { paths: () => null, points: { show: true, size: 6, fill: color(curve.color) } } : {}),
            ...(curve.dashed ? { dash: [6, 4] } : {}),
            value: (_: unknown, value: number | null) => number(value),
          })),
        ],
      }, data.current as import('uplot').AlignedData, parent);
      chart.current = made;
      resize = new ResizeObserver(() => made.setSize(size()));
      resize.observe(parent);
    });
    return () => {
      gone = true;
      resize?.disconnect();
      chart.current?.destroy();
      chart.current = null;
    };
  }, [shape]);
  useEffect(() => {
    chart.current?.setData(data.current as import('uplot').AlignedData);
  }, [curves]);
  return <div ref={box} class="chart" role="img" aria-label={curves.map(said).join('; ')} />;
}
