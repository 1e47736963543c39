// The report in words.

import { at, sentence } from '../api/client';
import type { Job, Report } from '../api/types';
import { duration, many, measure, number } from '../format';
import { VERDICT_MEANS } from '../words';
import { Badge, Panel } from './basic';

/** What the mesh is. */
function shape({ mesh, surface }: Report, unit: Job['unit']): string[] {
  if (!mesh) return [];
  const said = [];
  const pieces = mesh.components === 1 ? 'in one piece' : `in ${many(mesh.components ?? 0, 'piece')}`;
  said.push(mesh.closed
    ? `The mesh is closed, ${pieces}${mesh.genus ? `, with ${many(mesh.genus, 'handle')}` : ''}.`
    : `The mesh is open: it ends at ${many(mesh.boundary_edges ?? 0, 'edge')}, ${pieces}.`);
  if (mesh.manifold === false) said.push('It is not manifold everywhere.');
  const filled = surface?.unsupported_area_percent ?? 0;
  const near = measure(surface?.support_distance, unit);
  said.push(filled >= 0.05
    ? `${number(filled)} % of its area is further than ${near} from every point: filled in, not measured.`
    : `All of its area is within ${near} of a point.`);
  const cut = surface?.trimmed_area_percent ?? 0;
  if (cut > 0) said.push(`${number(cut)} % of the closed surface was cut away, because no points are near.`);
  return said;
}

/** How it lies to the points. */
function fit({ distances, validation_distances: held, cloud, normals }: Report, unit: Job['unit']): string[] {
  const said = [];
  if (distances?.cloud_to_mesh) {
    const { mean, p95 } = distances.cloud_to_mesh;
    said.push(`Points are ${measure(mean, unit)} from the mesh on average, 95 of 100 are within ${measure(p95, unit)}.`);
  }
  if (held?.cloud_to_mesh) said.push(`Those that were held back as a test: ${measure(held.cloud_to_mesh.mean, unit)} on average.`);
  if (cloud?.spacing) {
    said.push(`Neighbouring points are ${measure(cloud.spacing, unit)} apart${cloud.noise ? `, with a noise of ${measure(cloud.noise, unit)}` : ''}.`);
  }
  if (normals) said.push(normals === 'given' ? 'The normals of the file were used.' : 'Normals were estimated from the points.');
  const sure = cloud?.orientation_confidence;
  if (sure !== null && sure !== undefined) {
    const degree = sure > 0.95 ? 'It is sure' : sure > 0.8 ? 'It is fairly sure' : 'It is not sure';
    said.push(`${degree} which side is inside (${number(100 * sure)} %).`);
  }
  return said;
}

export function ReportPanel({ job, report }: { job: Job; report: Report | null }) {
  const { verdict, mesh } = job;
  return (
    <Panel title="Result" aside={verdict && <Badge of={verdict} />}>
      {verdict && <p><strong>{VERDICT_MEANS[verdict]}</strong></p>}
      {job.verdict_reasons && job.verdict_reasons.length > 0 && (
        <ul>{job.verdict_reasons.map(({ message }) => <li>{sentence(message)}</li>)}</ul>
      )}
      {mesh && (
        <dl class="numbers">
          <div><dt>Triangles</dt><dd>{mesh.triangles.toLocaleString('en')}</dd></div>
          <div><dt>Volume</dt><dd>{measure(mesh.volume, job.unit, 3)}</dd></div>
          <div><dt>Area</dt><dd>{measure(report?.mesh?.area, job.unit, 2)}</dd></div>
          <div><dt>Time</dt><dd>{report?.seconds?.total === undefined ? '–' : duration(report.seconds.total)}</dd></div>
        </dl>
      )}
      {report && <ul class="plain-list">{[...shape(report, job.unit), ...fit(report, job.unit)].map((line) => <li>{line}</li>)}</ul>}
      <p class="help">{(!job.unit || job.unit === 'unknown') && 'Lengths are in the unit of the cloud. '}<a href={at(`/v1/jobs/${job.id}/report`)}>The whole report</a></p>
    </Panel>
  );
}
