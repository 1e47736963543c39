// The files of a new job: how far each is, what is in it, and what stands in the way.

import { sentence } from '../api/client';
import type { Cloud } from '../api/types';
import { bytes, count, many, number, percent } from '../format';
import { assume, discard, drafts, type Draft } from '../state/drafts';
import { Panel, Progress, Trouble } from './basic';
import { ChooseFiles } from './drop';
import { Parts } from './segments';

/** What the service says of the choice of parts, and of which file it says so. */
export interface Fault {
  draft: number | undefined;
  text: string | undefined;
}

export function Files({ fault }: { fault: Fault }) {
  return (
    <Panel title="Files">
      {drafts.value.length === 0 && <p class="muted">Drop point clouds or segmentations anywhere on this page, or choose them.</p>}
      <ul class="files">{drafts.value.map((draft) => <FileLine key={draft.key} draft={draft} fault={fault.draft === draft.key ? fault.text : undefined} />)}</ul>
      <ChooseFiles label={drafts.value.length > 0 ? 'Add files…' : 'Choose files…'} />
    </Panel>
  );
}

function FileLine({ draft, fault }: { draft: Draft; fault: string | undefined }) {
  const { cloud, trouble, name } = draft;
  return (
    <li>
      <div class="file-line">
        <strong class="clamp">{name}</strong>
        <button type="button" class="plain small" aria-label={`Remove ${name}`} onClick={() => discard(draft)}>✕</button>
      </div>
      {trouble && <Trouble>{trouble}</Trouble>}
      {draft.code === 'orientation_missing' && <Assume draft={draft} />}
      {!cloud && !trouble && (
        <span class="running-line"><Progress share={draft.progress} label={`Upload of ${name}`} /> {percent(draft.progress)}</span>
      )}
      {draft.waits && <p class="hint" role="status">{draft.waits} The upload goes on by itself from where it was cut.</p>}
      {cloud && <span class="muted">{described(cloud)}</span>}
      {cloud?.segmentation?.assumed_orientation && (
        <p class="hint">The file does not say how it lies in the patient. It is taken as it is; left and right may be swapped.</p>
      )}
      {cloud?.warnings?.map(({ message }) => <p class="hint">{sentence(message)}</p>)}
      {cloud?.segmentation && <Parts draft={draft} fault={fault} />}
    </li>
  );
}

/** The way on for a file that does not say how it lies in the patient. */
function Assume({ draft }: { draft: Draft }) {
  const id = `assume-${draft.key}`;
  return (
    <>
      <button type="button" class="small" aria-describedby={id} onClick={() => assume(draft)}>Take it as it lies</button>
      <p id={id} class="help">Only where left and right do not matter, or where you know that they are right.</p>
    </>
  );
}

const KINDS = { labels: 'label', segments: 'segment', rois: 'region' };

function described(cloud: Cloud): string {
  const { segmentation } = cloud;
  if (segmentation) {
    const size = segmentation.size ? [`${segmentation.size.join(' × ')} voxels`] : [];
    return [many(segmentation.items.length, KINDS[segmentation.kind]), ...size, bytes(cloud.bytes), cloud.format.toUpperCase()].join(', ');
  }
  const parts = [many(cloud.points, 'point'), bytes(cloud.bytes), cloud.format.toUpperCase()];
  if (cloud.normals) parts.push('with normals');
  const { interior = 0, exterior = 0 } = cloud.labels ?? {};
  if (interior + exterior > 0) parts.push(`${count(interior)} inside, ${count(exterior)} outside`);
  if (cloud.bounds) {
    const { min, max } = cloud.bounds;
    parts.push(min.map((low, axis) => number((max[axis] ?? low) - low)).join(' × '));
  }
  return parts.join(', ');
}
