-- The tables of the service. Times are integer milliseconds since the Unix epoch and come from the
-- program, never from SQLite. Texts named *_id are identifiers of the form prefix_uuidv7, which sort
-- by time. JSON columns hold text that the program parses where it reads the row.

-- Uploaded clouds; the bytes are the file clouds/<sha256> of the data folder.
CREATE TABLE clouds (
    id         TEXT    NOT NULL PRIMARY KEY,
    sha256     TEXT    NOT NULL UNIQUE,          -- of the bytes, lower-case hexadecimal: the file's name
    bytes      INTEGER NOT NULL CHECK (bytes >= 0),
    format     TEXT    NOT NULL,                 -- short name of the file format
    points     INTEGER NOT NULL CHECK (points >= 0),
    summary    TEXT    NOT NULL,                 -- JSON object: bounds, normals, labels, warnings
    created_at INTEGER NOT NULL
) STRICT;

-- Jobs. cloud_id and derived_from are no foreign keys: a job that has ended outlives its cloud and
-- the job that it was derived from. A cloud that an unfinished job needs is not deleted.
CREATE TABLE jobs (
    id               TEXT    NOT NULL PRIMARY KEY,
    cloud_id         TEXT    NOT NULL,
    status           TEXT    NOT NULL
                     CHECK (status IN ('queued', 'running', 'succeeded', 'failed', 'cancelled')),
    phase            TEXT,                       -- stage of the present or last attempt
    preset           TEXT    NOT NULL,
    settings         TEXT    NOT NULL,           -- JSON object, complete
    labels           TEXT    NOT NULL,           -- JSON object of strings: the client's marks
    derived_from     TEXT,                       -- the job of which this is a retry
    created_at       INTEGER NOT NULL,
    started_at       INTEGER,                    -- start of the first attempt
    finished_at      INTEGER,                    -- set exactly in the final states
    attempt          INTEGER NOT NULL DEFAULT 0, -- the fence: +1 at every claim
    failures         INTEGER NOT NULL DEFAULT 0, -- attempts that failed; a release is none
    failure_reason   TEXT,                       -- JSON object: why the last failed attempt failed
    worker           TEXT,                       -- who holds it; set exactly while running
    lease_until      INTEGER,                    -- until when; set exactly while running
    cancel_requested INTEGER NOT NULL DEFAULT 0 CHECK (cancel_requested IN (0, 1)),
    progress         REAL    NOT NULL DEFAULT 0, -- 0 to 1
    eta_seconds      REAL,
    evaluations      INTEGER NOT NULL DEFAULT 0, -- of loss and gradient, so far
    loss             REAL,                       -- last training loss
    error            TEXT,                       -- JSON object; set exactly when failed
    report           TEXT,                       -- JSON object; set exactly when succeeded
    events           INTEGER NOT NULL DEFAULT 0, -- id of the newest event
    metrics          INTEGER NOT NULL DEFAULT 0, -- number of rows in metrics
    CHECK ((finished_at IS NOT NULL) = (status IN ('succeeded', 'failed', 'cancelled'))),
    CHECK ((worker IS NOT NULL) = (status = 'running')),
    CHECK ((lease_until IS NOT NULL) = (status = 'running')),
    CHECK ((error IS NOT NULL) = (status = 'failed')),
    CHECK ((report IS NOT NULL) = (status = 'succeeded'))
) STRICT;

CREATE INDEX jobs_by_status ON jobs (status, created_at, id); -- the queue, counts, expired leases
CREATE INDEX jobs_by_cloud ON jobs (cloud_id, id);            -- may a cloud be deleted; lists

-- What happened to a job, in order. seq orders the events of all jobs and is never used again, so
-- that a stream over all jobs can go on after the last one that it sent.
CREATE TABLE events (
    seq     INTEGER PRIMARY KEY AUTOINCREMENT,
    job_id  TEXT    NOT NULL REFERENCES jobs (id),
    id      INTEGER NOT NULL CHECK (id >= 1),    -- 1, 2, 3, … per job, over all attempts
    event   TEXT    NOT NULL,
    time    INTEGER NOT NULL,
    attempt INTEGER NOT NULL,
    data    TEXT    NOT NULL,                    -- JSON object
    UNIQUE (job_id, id)
) STRICT;

-- One row for each accepted iteration. A number that is not finite is NULL.
CREATE TABLE metrics (
    job_id          TEXT    NOT NULL REFERENCES jobs (id),
    evaluation      INTEGER NOT NULL,            -- of loss and gradient, so far
    iteration       INTEGER NOT NULL,            -- accepted iterations, so far
    loss            REAL,
    validation_loss REAL,                        -- NULL without a hold-out
    gradient_norm   REAL,
    step_length     REAL,
    weight_norms    BLOB    NOT NULL,            -- f64, little-endian, one a layer
    PRIMARY KEY (job_id, evaluation)
) STRICT, WITHOUT ROWID;

-- Histograms of the gradient at the chosen evaluations.
CREATE TABLE gradients (
    job_id     TEXT    NOT NULL REFERENCES jobs (id),
    evaluation INTEGER NOT NULL,
    data       TEXT    NOT NULL,                 -- JSON array, one object a layer
    PRIMARY KEY (job_id, evaluation)
) STRICT;

-- Encoded meshes (binary PLY): the result and the snapshots. An id is never used again, so that a
-- download that is under way never continues with another mesh.
CREATE TABLE meshes (
    id         INTEGER PRIMARY KEY AUTOINCREMENT,
    job_id     TEXT    NOT NULL REFERENCES jobs (id),
    evaluation INTEGER NOT NULL CHECK (evaluation >= 0), -- 0: the result
    vertices   INTEGER NOT NULL,
    triangles  INTEGER NOT NULL,
    bytes      INTEGER NOT NULL,
    sha256     TEXT    NOT NULL,                 -- of the encoding, lower-case hexadecimal
    created_at INTEGER NOT NULL,
    UNIQUE (job_id, evaluation)
) STRICT;

-- Their bytes. An ordinary rowid table: large rows of a WITHOUT ROWID table would fill its tree.
CREATE TABLE mesh_chunks (
    mesh_id  INTEGER NOT NULL REFERENCES meshes (id),
    position INTEGER NOT NULL,                   -- 0, 1, 2, …; all but the last have 256 KiB
    data     BLOB    NOT NULL,
    UNIQUE (mesh_id, position)
) STRICT;

-- The trained network of a job that succeeded.
CREATE TABLE models (
    job_id TEXT NOT NULL PRIMARY KEY REFERENCES jobs (id),
    data   BLOB NOT NULL,                        -- safetensors
    sha256 TEXT NOT NULL                         -- of data, lower-case hexadecimal
) STRICT;

-- Where training can go on after an interruption; erased when the job ends.
CREATE TABLE checkpoints (
    job_id     TEXT    NOT NULL PRIMARY KEY REFERENCES jobs (id),
    attempt    INTEGER NOT NULL,                 -- that wrote it
    evaluation INTEGER NOT NULL,                 -- at which it was taken
    data       BLOB    NOT NULL,
    created_at INTEGER NOT NULL
) STRICT;

-- Answers that are given again when a request is repeated with the same key.
CREATE TABLE idempotency (
    key            TEXT    NOT NULL,
    scope          TEXT    NOT NULL,             -- method and route
    request_sha256 TEXT    NOT NULL,             -- of what was asked, lower-case hexadecimal
    job_id         TEXT,                         -- the job that was made: its answers go with it
    status         INTEGER,                      -- HTTP status; NULL while the first is in flight
    headers        TEXT    NOT NULL DEFAULT '[]',-- JSON array of pairs
    body           BLOB    NOT NULL DEFAULT x'',
    created_at     INTEGER NOT NULL,
    PRIMARY KEY (key, scope)
) STRICT;

CREATE INDEX idempotency_by_age ON idempotency (created_at);
CREATE INDEX idempotency_by_job ON idempotency (job_id);

-- What stays of erased jobs.
CREATE TABLE tombstones (
    job_id     TEXT    NOT NULL PRIMARY KEY,
    deleted_at INTEGER NOT NULL,
    reason     TEXT    NOT NULL                  -- deleted, expired
) STRICT;
