-- What is asked about the queue is answered by this index alone: with the status in it, and named where
-- another one seems better. Else each waiting job is read from its row, which with its settings is far larger
-- than what the queue needs of it.
DROP INDEX jobs_waiting;
CREATE INDEX jobs_waiting ON jobs (tenant, priority DESC, created_at, id, cost_ms, status)
    WHERE status = 'queued';

-- As before; ORDER BY turn, created_at, id is the order in which jobs are claimed.
DROP VIEW queue;
CREATE VIEW queue AS
    SELECT id, tenant, created_at, cost_ms,
           MAX(COALESCE((SELECT served_ms FROM turns WHERE turns.tenant = jobs.tenant), 0),
               (SELECT turn FROM now_served))
           + SUM(cost_ms) OVER (PARTITION BY tenant ORDER BY priority DESC, created_at, id
                                ROWS UNBOUNDED PRECEDING)
           - cost_ms AS turn
    FROM jobs INDEXED BY jobs_waiting WHERE status = 'queued';
