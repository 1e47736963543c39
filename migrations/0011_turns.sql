-- Tenants take turns: fair queueing by start times. Each job has a turn, which is how much of the work
-- of its tenant is before it, in estimated milliseconds, from where the tenant stands. The least turn
-- is next. A tenant that was idle begins where the service stands, so that what it did not use is not
-- saved up, and what it used long ago is not held against it.

ALTER TABLE jobs ADD COLUMN priority INTEGER NOT NULL DEFAULT 0;     -- among those of the tenant; larger first
ALTER TABLE jobs ADD COLUMN cost_ms INTEGER NOT NULL DEFAULT 10000   -- estimated work
    CHECK (cost_ms >= 1);
ALTER TABLE jobs ADD COLUMN account TEXT NOT NULL DEFAULT '';        -- the key that submitted it; '': none
ALTER TABLE jobs ADD COLUMN counted_at INTEGER;                      -- until when its attempt is in compute

-- Where each tenant stands, and the service: the turn of the job that was claimed last.
CREATE TABLE turns (
    tenant    TEXT    NOT NULL PRIMARY KEY,
    served_ms INTEGER NOT NULL CHECK (served_ms >= 0)
) STRICT, WITHOUT ROWID;
CREATE TABLE now_served (
    only INTEGER NOT NULL PRIMARY KEY CHECK (only = 1),
    turn INTEGER NOT NULL CHECK (turn >= 0)
) STRICT;
INSERT INTO now_served VALUES (1, 0);

-- All that the queue needs, in the order of its partitions.
CREATE INDEX jobs_waiting ON jobs (tenant, priority DESC, created_at, id, cost_ms)
    WHERE status = 'queued';

-- The waiting jobs; ORDER BY turn, created_at, id is the order in which they are claimed.
CREATE VIEW queue AS
    SELECT id, tenant, created_at, cost_ms,
           MAX(COALESCE((SELECT served_ms FROM turns WHERE turns.tenant = jobs.tenant), 0),
               (SELECT turn FROM now_served))
           + SUM(cost_ms) OVER (PARTITION BY tenant ORDER BY priority DESC, created_at, id
                                ROWS UNBOUNDED PRECEDING)
           - cost_ms AS turn
    FROM jobs WHERE status = 'queued';

-- How long workers worked, by days since the epoch (UTC). Erased jobs stay in it.
CREATE TABLE compute (
    day     INTEGER NOT NULL,
    tenant  TEXT    NOT NULL,
    account TEXT    NOT NULL,                    -- as in jobs
    ms      INTEGER NOT NULL CHECK (ms >= 0),
    PRIMARY KEY (day, tenant, account)
) STRICT, WITHOUT ROWID;
