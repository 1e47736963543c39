// One job, kept current by events.

import { useEffect, useState } from 'preact/hooks';
import { Failure, get } from '../api/client';
import type { Job, Warning } from '../api/types';
import { changed } from './jobs';
import { onEvent, onReturn } from './live';

export interface Watched {
  job: Job | null;
  failure: Failure | null;
  /** Those that the run gave so far. */
  warnings: Warning[];
  /** Evaluations of the snapshots that came while the page was open. */
  snapshots: number;
}

export function useJob(id: string): Watched & { renew: (job: Job) => void } {
  const [watched, setWatched] = useState<Watched>({ job: null, failure: null, warnings: [], snapshots: 0 });
  useEffect(() => {
    let gone = false;
    const look = () => void get<Job>(`/v1/jobs/${id}`).then(
      (job) => { if (!gone) setWatched((old) => ({ ...old, job, failure: null })); },
      (error: unknown) => {
        // A service that is away comes back; a job that is gone does not.
        if (!gone && error instanceof Failure && error.status > 0) setWatched((old) => ({ ...old, failure: error }));
      },
    );
    look();
    const forget = [
      onReturn(look),
      onEvent((event) => {
        if (event.data.job_id !== id) {
          // The queue moved.
          if (/succeeded|failed|cancelled/.test(event.name)) setWatched((old) => {
            if (old.job?.status === 'queued') look();
            return old;
          });
          return;
        }
        setWatched((old) => {
          const job = old.job && changed(old.job, event);
          if (!job) {
            look();
            return old;
          }
          const warning = event.name === 'job.warning' && event.data as unknown as Warning;
          return {
            ...old,
            job,
            warnings: warning ? [...old.warnings, warning] : old.warnings,
            snapshots: old.snapshots + (event.name === 'job.snapshot' ? 1 : 0),
          };
        });
      }),
    ];
    return () => {
      gone = true;
      forget.forEach((stop) => stop());
    };
  }, [id]);
  return { ...watched, renew: (job) => setWatched((old) => ({ ...old, job })) };
}
