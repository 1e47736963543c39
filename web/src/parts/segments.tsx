// Which parts of a medical file become surfaces: one job each.

import type { Part } from '../api/types';
import { count, many, number } from '../format';
import { choose, partsOf, type Draft } from '../state/drafts';

const TITLES = { labels: 'Labels', segments: 'Segments', rois: 'Regions' };
const NOUNS = { labels: 'Label', segments: 'Segment', rois: 'Region' };

/** More parts than this stand in a box of their own that scrolls. */
const MANY = 8;

/** What there is of a part, in the words of its kind of file. */
function extent({ voxels, contours, slices, volume_mm3: volume }: Part): string {
  const of = voxels !== undefined ? [many(voxels, 'voxel')] : contours !== undefined ? [many(contours, 'contour')] : [];
  const size = volume >= 1000 ? `${number(volume / 1000)} ml` : `${number(volume)} mm³`;
  return [...of, many(slices, 'slice'), size].join(', ');
}

export function Parts({ draft, fault }: { draft: Draft; fault: string | undefined }) {
  const { cloud, chosen, key, name } = draft;
  const kind = cloud?.segmentation?.kind ?? 'labels';
  const parts = partsOf(cloud);
  const set = (numbers: number[], yes: boolean) => {
    const next = new Set(chosen);
    for (const one of numbers) {
      if (yes) next.add(one);
      else next.delete(one);
    }
    choose(draft, next);
  };
  const all = parts.map((part) => part.number);
  const id = `parts-${key}`;
  return (
    <fieldset class={`parts ${fault ? 'faulty' : ''}`} aria-describedby={fault ? `${id}-fault` : undefined}>
      <legend>{TITLES[kind]} of {name} that become surfaces, a job each</legend>
      {fault && <p id={`${id}-fault`} class="fault">{fault}</p>}
      {parts.length > 1 && (
        <div class="buttons">
          <button type="button" class="small" onClick={() => set(all, true)}>Choose all</button>
          <button type="button" class="small" onClick={() => set(all, false)}>Choose none</button>
          <span class="muted" role="status">{count(chosen.size)} of {count(all.length)} chosen</span>
        </div>
      )}
      {parts.length === 0 && <p class="muted">Nothing is marked in this file.</p>}
      <div class={parts.length > MANY ? 'part-list long' : 'part-list'}>
        {parts.map((part) => (
          <label class="check">
            <input type="checkbox" checked={chosen.has(part.number)} onChange={({ currentTarget }) => set([part.number], currentTarget.checked)} />
            {part.color && <span class="swatch" style={{ background: part.color }} aria-hidden="true" />}
            <span class="part-name">
              {part.name || `${NOUNS[kind]} ${part.number}`}{' '}
              <span class="muted">{part.name ? `number ${part.number}, ` : ''}{extent(part)}</span>
            </span>
          </label>
        ))}
      </div>
    </fieldset>
  );
}
