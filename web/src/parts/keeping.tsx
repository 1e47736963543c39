// How long a job is kept, whether it is held, and when it has its turn.

import { useState } from 'preact/hooks';
import { patch, words } from '../api/client';
import type { Job, JobKeep } from '../api/types';
import { renew } from '../state/jobs';
import { Panel, Trouble } from './basic';
import { say } from './say';

/** Times to live, in the words of the API and of people. */
const TIMES: Record<string, string> = {
  never: 'For ever', '1d': 'A day', '7d': 'A week', '30d': '30 days', '365d': 'A year', download: 'Until its mesh is downloaded',
};

const ORDERS: Record<string, string> = { 9: 'first of all', 0: 'usual', '-9': 'last of all' };

/** From the one that goes first to the one that goes last, as the contract bounds them. */
const PRIORITIES = Array.from({ length: 19 }, (_, i) => 9 - i);

interface ChoiceProps {
  id: string;
  value: string;
  onChange: (value: string) => void;
}

/** For how long; `standard` is what an empty value stands for, where it may be empty. */
export function KeptFor({ id, value, onChange, standard }: ChoiceProps & { standard?: string }) {
  const others = value && !(value in TIMES) ? [value] : [];
  return (
    <select id={id} value={value} onChange={({ currentTarget }) => onChange(currentTarget.value)}>
      {standard !== undefined && <option value="">{standard}</option>}
      {[...Object.entries(TIMES), ...others.map((time) => [time, time])].map(([time, text]) => <option value={time}>{text}</option>)}
    </select>
  );
}

export function lifetime(ttl: string | null | undefined): string {
  const time = ttl ?? 'never';
  return TIMES[time] ?? time;
}

export function Turn({ id, value, onChange }: ChoiceProps) {
  return (
    <select id={id} value={value} onChange={({ currentTarget }) => onChange(currentTarget.value)}>
      {PRIORITIES.map((priority) => {
        const text = priority > 0 ? `+${priority}` : String(priority).replace('-', '−');
        return <option value={String(priority)}>{ORDERS[priority] ? `${text}, ${ORDERS[priority]}` : text}</option>;
      })}
    </select>
  );
}

export function KeepPanel({ job, onChange }: { job: Job; onChange: (job: Job) => void }) {
  const [ttl, setTtl] = useState(job.ttl ?? 'never');
  const [priority, setPriority] = useState(String(job.priority ?? 0));
  const [trouble, setTrouble] = useState('');
  const waits = job.status === 'queued';
  const wanted: JobKeep = {
    ...(ttl === (job.ttl ?? 'never') ? {} : { ttl }),
    ...(waits && priority !== String(job.priority ?? 0) ? { priority: Number(priority) } : {}),
  };
  const send = async (change: JobKeep, done: string) => {
    try {
      const next = await patch<Job>(`/v1/jobs/${job.id}`, change);
      renew(next);
      onChange(next);
      setTrouble('');
      say(done);
    } catch (error) {
      setTrouble(words(error));
    }
  };
  return (
    <Panel title="Keeping">
      {trouble && <Trouble>{trouble}</Trouble>}
      <div class="inline">
        <button type="button" class="small" aria-describedby="hold-help" onClick={() => void send({ hold: !job.hold }, job.hold ? 'The job is let go.' : 'The job is held.')}>
          {job.hold ? 'Let go' : 'Hold'}</button>
        <span id="hold-help" class="help">{job.hold ? 'Then it can be erased again.' : 'Then nothing erases it, until it is let go.'}</span>
      </div>
      <form class="keeping" onSubmit={(event) => {
        event.preventDefault();
        if (Object.keys(wanted).length > 0) void send(wanted, 'Saved.');
      }}>
        <div class="field"><label for="ttl">Kept after its end</label><KeptFor id="ttl" value={ttl} onChange={setTtl} /></div>
        {waits && <div class="field"><label for="priority">Priority in the queue</label><Turn id="priority" value={priority} onChange={setPriority} /></div>}
        <button type="submit" class="small" disabled={Object.keys(wanted).length === 0}>Save</button>
      </form>
    </Panel>
  );
}
