// Who did what, newest first.

import { useEffect, useState } from 'preact/hooks';
import { get, words } from '../api/client';
import type { AuditPage, AuditRow } from '../api/types';
import { href } from '../state/route';
import { short, Panel, Time, Trouble } from './basic';

/** Rows of a page. */
const ROWS = 25;

function Thing({ object }: { object: string }) {
  if (object.startsWith('job_')) return <a href={href(`jobs/${object}`)}>Job {short(object)}</a>;
  if (object.startsWith('cld_')) return <a href={href('jobs', { cloud_id: object })}>Cloud {short(object)}</a>;
  return <>{object}</>;
}

export function AuditPanel() {
  const [rows, setRows] = useState<AuditRow[]>([]);
  const [cursor, setCursor] = useState<string | null>(null);
  const [trouble, setTrouble] = useState('');
  const look = (after: string | null) => void get<AuditPage>(`/v1/audit?limit=${ROWS}${after ? `&cursor=${encodeURIComponent(after)}` : ''}`).then((page) => {
    setRows((old) => [...after ? old : [], ...page.items]);
    setCursor(page.next_cursor);
    setTrouble('');
  }, (error: unknown) => setTrouble(words(error)));
  useEffect(() => look(null), []);
  return (
    <Panel title="Audit trail" aside={<button type="button" class="small" onClick={() => look(null)}>Look again</button>}>
      {trouble && <Trouble>{trouble}</Trouble>}
      <div class="wide-table" tabIndex={0} role="region" aria-label="Rows of the audit trail">
        <table class="small-table">
          <thead><tr>{['Time', 'Who', 'From', 'Did', 'To', 'Outcome'].map((name) => <th scope="col">{name}</th>)}</tr></thead>
          <tbody>{rows.map((row) => (
            <tr key={row.seq}>
              <td><Time at={row.time} /></td>
              <td>{row.actor ?? 'a stranger'}</td>
              <td>{row.address ?? '–'}</td>
              <td>{row.event}</td>
              <td><Thing object={row.object} /></td>
              <td>{row.outcome === 0 ? 'done' : 'refused'}</td>
            </tr>
          ))}</tbody>
        </table>
      </div>
      {cursor && <p><button type="button" class="small" onClick={() => look(cursor)}>Older rows</button></p>}
      <p class="help"><code>meshway audit verify</code> checks the whole trail, <code>meshway audit export</code> writes it out.</p>
    </Panel>
  );
}
