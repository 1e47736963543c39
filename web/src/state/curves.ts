// The training curves of a job: all of it in a few hundred rows, then what events add.

import { useEffect, useState } from 'preact/hooks';
import { get } from '../api/client';
import type { MetricSeries, Status } from '../api/types';
import { onEvent, onReturn } from './live';

export interface Curves {
  evaluation: number[];
  loss: (number | null)[];
  validation_loss: (number | null)[];
  gradient_norm: (number | null)[];
  /** Of each layer, from input to output. */
  weight_norms: (number | null)[][];
  /** Blocks that are fitted, in rows of blocks, whose losses are of another kind; else null. */
  blocks: (number | null)[];
}

const NONE: Curves = { evaluation: [], loss: [], validation_loss: [], gradient_norm: [], weight_norms: [], blocks: [] };

async function load(id: string): Promise<Curves> {
  const fields = 'evaluation,loss,validation_loss,gradient_norm,weight_norms,blocks';
  const { series } = await get<MetricSeries>(`/v1/jobs/${id}/metrics?max_points=500&fields=${fields}`);
  return {
    evaluation: series.evaluation,
    loss: series.loss ?? [],
    validation_loss: series.validation_loss ?? [],
    gradient_norm: series.gradient_norm ?? [],
    weight_norms: series.weight_norms ?? [],
    blocks: series.blocks ?? [],
  };
}

export function useCurves(id: string, status: Status | undefined): Curves {
  const [curves, setCurves] = useState(NONE);
  useEffect(() => {
    let gone = false;
    const again = () => void load(id).then((found) => {
      if (!gone) setCurves(found);
    }, () => undefined);
    again();
    const forget = [
      onReturn(again),
      onEvent(({ name, data }) => {
        if (name !== 'training.metrics' || data.job_id !== id) return;
        setCurves((old) => (Number(data['evaluation']) <= (old.evaluation.at(-1) ?? -1) ? old : {
          evaluation: [...old.evaluation, data['evaluation'] as number],
          loss: [...old.loss, data['loss'] as number | null],
          validation_loss: [...old.validation_loss, (data['validation_loss'] ?? null) as number | null],
          gradient_norm: [...old.gradient_norm, (data['gradient_norm'] ?? null) as number | null],
          weight_norms: [...old.weight_norms, (data['weight_norms'] ?? []) as (number | null)[]],
          blocks: [...old.blocks, (data['blocks'] ?? null) as number | null],
        }));
      }),
    ];
    return () => {
      gone = true;
      forget.forEach((stop) => stop());
    };
  }, [id, status]);
  return curves;
}

/** The losses of the whole, or those of blocks. */
export function losses({ evaluation, loss, blocks }: Curves, ofBlocks: boolean): { x: number[]; y: (number | null)[] } {
  const belongs = (_: unknown, i: number) => ((blocks[i] ?? null) !== null) === ofBlocks;
  return { x: evaluation.filter(belongs), y: loss.filter(belongs) };
}

/** The norms of the weights, a curve each layer. */
export function norms({ evaluation, weight_norms: rows }: Curves): { x: number[]; y: (number | null)[] }[] {
  const layers = Math.max(0, ...rows.map((row) => row.length));
  return Array.from({ length: layers }, (_, layer) => ({ x: evaluation, y: rows.map((row) => row[layer] ?? null) }));
}
