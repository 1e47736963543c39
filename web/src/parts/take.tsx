// Files to take along.

import { useState } from 'preact/hooks';
import { at } from '../api/client';
import type { Job } from '../api/types';
import { COLOURED, FORMATS } from '../words';
import { Panel } from './basic';

/** Coordinates of a patient that a mesh can be written in. */
const SPACES = [
  { name: 'source', text: 'as in the file' }, { name: 'lps', text: 'LPS, as DICOM has them' }, { name: 'ras', text: 'RAS, as NIfTI has them' },
];

export function Downloads({ job }: { job: Job }) {
  const [space, setSpace] = useState('source');
  const [first, ...others] = FORMATS;
  const inPatient = job.frame === 'lps' || job.frame === 'ras';
  const link = (ending: string, colors?: string) => {
    const query = new URLSearchParams({ ...(space === 'source' ? {} : { space }), ...(colors ? { colors } : {}) }).toString();
    return at(`/v1/jobs/${job.id}/mesh.${ending}${query ? `?${query}` : ''}`);
  };
  return (
    <Panel title="Download">
      {inPatient && (
        <div class="field"><label for="space">Coordinates</label>
          <select id="space" value={space} onChange={({ currentTarget: { value } }) => setSpace(value)}>
            {SPACES.map(({ name, text }) => <option value={name}>{text}</option>)}
          </select>
        </div>
      )}
      {first && (
        <>
          <a class="button primary" href={link(first.name)} download>Download {first.name.toUpperCase()}</a>
          <p class="help">For {first.text}.</p>
        </>
      )}
      <ul class="downloads">
        {others.map(({ name, text }) => (
          <li><a href={link(name)} download>{name.toUpperCase()}</a> {text}</li>
        ))}
        {COLOURED.map((name) => (
          <li><a href={link(name, 'distance')} download={`${job.id}-coloured.${name}`}>{name.toUpperCase()} in colours</a> of the distance to the points</li>
        ))}
        {inPatient && space !== 'ras' && <li><a href={link('dcm')} download>DICOM</a> archives and planning, in the patient's frame</li>}
        {job.links['mask'] && job.mesh?.closed && (
          <li><a href={at(job.links['mask'])} download>Mask, as NIfTI</a> on the voxels of the file</li>
        )}
        <li><a href={at(`/v1/jobs/${job.id}/report`)} download={`${job.id}-report.json`}>Report, as JSON</a></li>
        <li><a href={at(`/v1/jobs/${job.id}/metrics?format=csv`)} download={`${job.id}-metrics.csv`}>Curves, as CSV</a></li>
        <li><a href={at(`/v1/jobs/${job.id}/model`)} download>Network, as safetensors</a></li>
        {job.links['cloud'] && <li><a href={at(`/v1/clouds/${job.cloud_id}/content`)} download>The file as uploaded</a></li>}
      </ul>
    </Panel>
  );
}
