-- Processes that share the database: services and those of workers on other machines. One that was not seen
-- for a while is gone.
CREATE TABLE nodes (
    name       TEXT    NOT NULL PRIMARY KEY,   -- of this start, which no other start has
    host       TEXT    NOT NULL,
    role       TEXT    NOT NULL CHECK (role IN ('serve', 'worker')),
    version    TEXT    NOT NULL,
    slots      INTEGER NOT NULL CHECK (slots >= 0),
    started_at INTEGER NOT NULL,
    seen_at    INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

-- What one process does for all of them, and until when nobody else does it.
CREATE TABLE duties (
    name TEXT    NOT NULL PRIMARY KEY,
    node TEXT    NOT NULL,
    ends INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

-- Who works on a request that is in flight; empty where one process serves alone.
ALTER TABLE idempotency ADD COLUMN node TEXT NOT NULL DEFAULT '';

-- People who have signed in. The cookie is nowhere; what is kept of the password tells whether it is still
-- that of the configuration.
CREATE TABLE sessions (
    hash      TEXT    NOT NULL PRIMARY KEY,    -- of what the cookie holds
    user_name TEXT    NOT NULL,
    password  TEXT    NOT NULL,                -- hash of the password's hash
    began_at  INTEGER NOT NULL,
    used_at   INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
CREATE INDEX sessions_by_use ON sessions (used_at);

-- With an object store the bytes of an upload that may go on are objects: at says where in it they are.
CREATE TABLE upload_parts (
    upload_id TEXT    NOT NULL REFERENCES uploads (id),
    at        INTEGER NOT NULL CHECK (at >= 0),
    bytes     INTEGER NOT NULL CHECK (bytes > 0),
    object    TEXT    NOT NULL UNIQUE,
    PRIMARY KEY (upload_id, at)
) STRICT, WITHOUT ROWID;

-- Processes with copies of what was erased ask what went lately.
CREATE INDEX tombstones_by_time ON tombstones (deleted_at);
