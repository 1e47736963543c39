// How the service is: whether it takes work, what it does, what may be asked of it.

import { useEffect, useState } from 'preact/hooks';
import { answer, at, Failure, get, sentence, words } from '../api/client';
import type { Limits, Ready, Version } from '../api/types';
import { bytes, count, duration, many } from '../format';
import { Panel, Time, Trouble } from '../parts/basic';
import { AuditPanel } from '../parts/audit';
import { KeysPanel } from '../parts/keys';
import { lifetime } from '../parts/keeping';
import { limits, loadLimits } from '../state/limits';
import { connection } from '../state/live';
import { href } from '../state/route';
import { known, may } from '../state/session';

/** Seconds between two looks. */
const EVERY = 5;

const CHECKS: Record<string, string> = {
  database: 'Database', disk: 'Disk', workers: 'Workers', not_draining: 'Takes new work',
};

interface State {
  checks: Ready['checks'];
  /** By name and labels, as Prometheus writes them; null for those who may not see them. */
  metrics: Map<string, number> | null;
}

/** Also a service that is not ready tells its checks. */
async function checks(): Promise<Ready['checks']> {
  try {
    return (await get<Ready>('/readyz')).checks;
  } catch (error) {
    const problem = error instanceof Failure ? error.problem as { checks?: Ready['checks'] } | null : null;
    if (problem?.checks) return problem.checks;
    throw error;
  }
}

async function metrics(): Promise<Map<string, number>> {
  const text = await (await answer('/metrics')).text();
  const lines = text.split('\n').filter((line) => line && !line.startsWith('#'));
  return new Map(lines.map((line) => {
    const space = line.lastIndexOf(' ');
    return [line.slice(0, space), Number(line.slice(space + 1))];
  }));
}

export function SystemPage() {
  const admin = may('admin');
  const [version, setVersion] = useState<Version | null>(null);
  const [state, setState] = useState<State | null>(null);
  const [trouble, setTrouble] = useState('');
  useEffect(() => {
    let gone = false;
    const fail = (error: unknown) => { if (!gone) setTrouble(words(error)); };
    get<Version>('/v1/version').then(setVersion, fail);
    void loadLimits().catch(fail);
    const look = () => Promise.all([checks(), admin ? metrics() : null]).then(([found, numbers]) => {
      if (gone) return;
      setState({ checks: found, metrics: numbers });
      setTrouble('');
    }, fail);
    void look();
    const timer = setInterval(() => { if (!document.hidden) void look(); }, EVERY * 1000);
    return () => {
      gone = true;
      clearInterval(timer);
    };
  }, [connection.value, admin]);
  return (
    <>
      <div class="page-head"><h1 tabIndex={-1}>System</h1></div>
      {trouble && <Trouble>{trouble}</Trouble>}
      <div class="halves">
        <div>
          {state && <ChecksPanel checks={state.checks} />}
          {state?.metrics && <WorkPanel metrics={state.metrics} />}
        </div>
        <div>
          {version && (
            <Panel title="Service">
              <dl class="numbers">
                <div><dt>Meshway</dt><dd>{version.version}</dd></div>
                <div><dt>Started</dt><dd><Time at={version.started_at} /></dd></div>
              </dl>
              <p><a href={at('/docs')}>The API for people</a>, <a href={at('/openapi.yaml')}>for machines</a>{admin && <>, <a href={at('/metrics')}>metrics for Prometheus</a></>}</p>
            </Panel>
          )}
          {limits.value && <RetentionPanel limits={limits.value} />}
          {limits.value && <LimitsPanel limits={limits.value} />}
        </div>
      </div>
      {admin && <KeysPanel />}
      {may('audit') && known() && <AuditPanel />}
    </>
  );
}

function ChecksPanel({ checks: found }: { checks: Ready['checks'] }) {
  return (
    <Panel title="Ready">
      <ul class="plain-list checks">{Object.entries(found).map(([name, { ok, detail }]) => (
        <li><span class={`badge ${ok ? 'good' : 'failed'}`}>{ok ? '✓ Good' : '✕ Trouble'}</span> {CHECKS[name] ?? name}
          {detail && <p class="hint">{sentence(detail)}</p>}</li>
      ))}</ul>
    </Panel>
  );
}

function WorkPanel({ metrics: found }: { metrics: Map<string, number> }) {
  const value = (name: string) => found.get(name) ?? 0;
  const rows: [string, string][] = [
    ['Queued', count(value('meshway_jobs{status="queued"}'))],
    ['Running', count(value('meshway_jobs{status="running"}'))],
    ['Succeeded', count(value('meshway_jobs{status="succeeded"}'))],
    ['Failed', count(value('meshway_jobs{status="failed"}'))],
    ['Cancelled', count(value('meshway_jobs{status="cancelled"}'))],
    ['Workers busy', count(value('meshway_workers{state="busy"}'))],
    ['Workers idle', count(value('meshway_workers{state="idle"}'))],
    ['Disk free', bytes(value('meshway_storage_free_bytes'))],
  ];
  return (
    <Panel title="Work">
      <dl class="numbers">{rows.map(([name, text]) => <div><dt>{name}</dt><dd>{text}</dd></div>)}</dl>
    </Panel>
  );
}

/** How long things are kept where nobody asks for another time. */
function RetentionPanel({ limits: { job_ttl: job, cloud_ttl: cloud, audit_days: days } }: { limits: Limits }) {
  const rows: [string, string][] = [
    ['A job, after its end', lifetime(job)],
    ['A cloud, after its upload', lifetime(cloud)],
    ...(known() ? [['A row of the audit trail', `${count(days ?? 0)} days`] as [string, string]] : []),
  ];
  return (
    <Panel title="Kept">
      <dl class="numbers">{rows.map(([name, text]) => <div><dt>{name}</dt><dd>{text}</dd></div>)}</dl>
      <p class="help">Each job and each cloud may ask for another time; what is held stays. <a href={href('jobs')}>The list of jobs</a> says when each is erased.</p>
    </Panel>
  );
}

function LimitsPanel({ limits }: { limits: Limits }) {
  const memory = (value: number | null) => (value === null ? 'no limit' : bytes(value));
  const rows: [string, string][] = [
    ['Points of a cloud', count(limits.points)],
    ['Size of an upload', bytes(limits.body_bytes)],
    ['Jobs that wait', count(limits.queued_jobs)],
    ['Time of a job', duration(limits.job_seconds)],
    ['Memory of a worker', memory(limits.worker_memory_bytes)],
    ['Labels of a job', many(limits.labels, 'label')],
    ['Disk kept free', bytes(limits.disk_reserve_bytes)],
    ['Live views at once', count(limits.event_streams)],
  ];
  return (
    <Panel title="Limits">
      <table class="small-table">
        <thead><tr><th scope="col">Of</th><th scope="col">At most</th></tr></thead>
        <tbody>{rows.map(([name, text]) => <tr><th scope="row">{name}</th><td>{text}</td></tr>)}</tbody>
      </table>
    </Panel>
  );
}
