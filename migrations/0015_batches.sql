-- Jobs that were asked for together. A batch goes with the last of its jobs.
CREATE TABLE batches (
    id         TEXT    NOT NULL PRIMARY KEY,
    tenant     TEXT    NOT NULL,
    made       INTEGER NOT NULL CHECK (made >= 1),       -- jobs that it had at first
    progress   REAL    NOT NULL DEFAULT 0,               -- 0 to 1: what it has had at the least
    created_at INTEGER NOT NULL
) STRICT;
CREATE INDEX batches_by_tenant ON batches (tenant, id);

ALTER TABLE jobs ADD COLUMN batch_id TEXT;               -- the batch that it was made in
CREATE INDEX jobs_by_batch ON jobs (batch_id, id) WHERE batch_id IS NOT NULL;

-- Answers hold nothing of their batch but its name; they are given again with the batch as it is.
ALTER TABLE idempotency ADD COLUMN batch_id TEXT;

-- Mean over the jobs; one that has ended or was erased counts as done.
CREATE VIEW batch_states AS
    SELECT batches.id, batches.tenant, batches.made, batches.created_at,
           MAX(batches.progress,
               1 - (SELECT TOTAL(CASE WHEN finished_at IS NULL THEN 1 - jobs.progress ELSE 0 END)
                    FROM jobs WHERE jobs.batch_id = batches.id) / batches.made) AS progress
    FROM batches;

-- A job that is worked on anew begins at 0; its batch does not go back with it.
CREATE TRIGGER batches_do_not_go_back BEFORE UPDATE OF progress ON jobs
WHEN NEW.batch_id IS NOT NULL AND NEW.progress < OLD.progress
BEGIN
    UPDATE batches SET progress = (SELECT progress FROM batch_states WHERE id = NEW.batch_id)
    WHERE id = NEW.batch_id;
END;
