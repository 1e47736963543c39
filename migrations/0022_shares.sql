-- Runs of blocks that the worker of a job offers to idle ones while it fits them (records/shares.rs). They end
-- with its attempt: whoever wants to know whether one is wanted looks whether its row is there.
CREATE TABLE shares (
    job_id     TEXT    NOT NULL REFERENCES jobs (id),
    share      INTEGER NOT NULL CHECK (share >= 0),
    attempt    INTEGER NOT NULL,
    processor  TEXT    NOT NULL,                  -- what who fits it must be
    object     TEXT    NOT NULL UNIQUE,           -- its input; its networks once it is fitted
    bytes      INTEGER NOT NULL CHECK (bytes >= 0),
    helper     TEXT,                              -- the worker that has begun with it
    fitted     INTEGER NOT NULL DEFAULT 0 CHECK (fitted IN (0, 1)),
    created_at INTEGER NOT NULL,
    PRIMARY KEY (job_id, share)
) STRICT, WITHOUT ROWID;
CREATE INDEX shares_open ON shares (created_at, job_id, share) WHERE helper IS NULL;
