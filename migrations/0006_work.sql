-- How long the attempts of a job have worked, by the clocks of their workers, which no change of the
-- time of day touches. For jobs that are under way, what their events tell is taken over.
ALTER TABLE jobs ADD COLUMN worked_ms INTEGER NOT NULL DEFAULT 0 CHECK (worked_ms >= 0);

UPDATE jobs SET worked_ms =
    (SELECT COALESCE(SUM(worked), 0) FROM
         (SELECT MAX(MAX(time) - MIN(time), 0) AS worked FROM events
          WHERE job_id = jobs.id AND attempt >= 1 AND event <> 'job.queued'
          GROUP BY attempt))
 WHERE status IN ('queued', 'running');
