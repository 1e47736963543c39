-- Every record belongs to a tenant; those from before belong to 'default'. Two tenants with the same
-- bytes have a cloud each, and a key of one is not that of the other.

CREATE TABLE clouds_of_tenants (
    id         TEXT    NOT NULL PRIMARY KEY,
    tenant     TEXT    NOT NULL,
    sha256     TEXT    NOT NULL,                 -- of the bytes, lower-case hexadecimal: the file's name
    bytes      INTEGER NOT NULL CHECK (bytes >= 0),
    format     TEXT    NOT NULL,                 -- short name of the file format
    points     INTEGER NOT NULL CHECK (points >= 0),
    summary    TEXT    NOT NULL,                 -- JSON object: bounds, normals, labels, warnings
    created_at INTEGER NOT NULL,
    UNIQUE (tenant, sha256)
) STRICT;
INSERT INTO clouds_of_tenants
    SELECT id, 'default', sha256, bytes, format, points, summary, created_at FROM clouds;
DROP TABLE clouds;
ALTER TABLE clouds_of_tenants RENAME TO clouds;
CREATE INDEX clouds_by_tenant ON clouds (tenant, id);
CREATE INDEX clouds_by_sha256 ON clouds (sha256);             -- may the file be removed

ALTER TABLE jobs ADD COLUMN tenant TEXT NOT NULL DEFAULT 'default';
CREATE INDEX jobs_by_tenant ON jobs (tenant, id);
DROP INDEX jobs_by_verdict;
CREATE INDEX jobs_by_verdict ON jobs (tenant, json_extract(report, '$.verdict'), id)
    WHERE report IS NOT NULL;

ALTER TABLE events ADD COLUMN tenant TEXT NOT NULL DEFAULT 'default'; -- that of the job
CREATE INDEX events_by_tenant ON events (tenant, seq);

ALTER TABLE tombstones ADD COLUMN tenant TEXT NOT NULL DEFAULT 'default';

CREATE TABLE idempotency_of_tenants (
    tenant         TEXT    NOT NULL,
    key            TEXT    NOT NULL,
    scope          TEXT    NOT NULL,             -- method and route
    request_sha256 TEXT    NOT NULL,             -- of what was asked, lower-case hexadecimal
    job_id         TEXT,                         -- the job that was made: its answers go with it
    cloud_id       TEXT,                         -- the cloud that was uploaded
    status         INTEGER,                      -- HTTP status; NULL while the first is in flight
    headers        TEXT    NOT NULL DEFAULT '[]',-- JSON array of pairs
    body           BLOB    NOT NULL DEFAULT x'',
    created_at     INTEGER NOT NULL,
    PRIMARY KEY (tenant, key, scope)
) STRICT;
INSERT INTO idempotency_of_tenants
    SELECT 'default', key, scope, request_sha256, job_id, cloud_id, status, headers, body, created_at
    FROM idempotency;
DROP TABLE idempotency;
ALTER TABLE idempotency_of_tenants RENAME TO idempotency;
CREATE INDEX idempotency_by_age ON idempotency (created_at);
CREATE INDEX idempotency_by_job ON idempotency (job_id);
CREATE INDEX idempotency_by_cloud ON idempotency (cloud_id);

-- Who did what. A row is written in the transaction of the act, and never changed. Each has the hash
-- of the one before it in its own hash, so that a row that is changed, removed or moved shows.
CREATE TABLE audit (
    seq     INTEGER PRIMARY KEY AUTOINCREMENT,   -- 1, 2, 3, … without a gap
    at      INTEGER NOT NULL,
    tenant  TEXT,                                -- NULL: nobody's, as of a stranger
    actor   TEXT,                                -- name of the key; NULL for a stranger
    key     TEXT,                                -- first digits of the key's hash
    address TEXT,                                -- the other end of the connection
    action  TEXT    NOT NULL CHECK (action IN ('C', 'R', 'U', 'D', 'E')),
    event   TEXT    NOT NULL,                    -- cloud.create, mesh.read, …
    object  TEXT    NOT NULL,                    -- id of a cloud or a job, or a route
    outcome INTEGER NOT NULL CHECK (outcome IN (0, 4, 8, 12)), -- 0: done, 8: refused
    request TEXT    NOT NULL,                    -- id of the request
    hash    TEXT    NOT NULL                     -- SHA-256, lower-case hexadecimal
) STRICT;
CREATE INDEX audit_by_tenant ON audit (tenant, seq);
CREATE INDEX audit_by_age ON audit (at);

-- Where the trail begins once old rows were removed: the last of them and its hash.
CREATE TABLE audit_begins (
    seq  INTEGER NOT NULL PRIMARY KEY,
    hash TEXT    NOT NULL
) STRICT;

CREATE TRIGGER audit_is_not_changed BEFORE UPDATE ON audit
BEGIN SELECT RAISE(ABORT, 'the audit trail is not changed'); END;
CREATE TRIGGER audit_is_not_removed BEFORE DELETE ON audit
WHEN OLD.seq > COALESCE((SELECT MAX(seq) FROM audit_begins), 0)
BEGIN SELECT RAISE(ABORT, 'the audit trail is not removed'); END;
CREATE TRIGGER audit_begins_with_what_is_there BEFORE INSERT ON audit_begins
WHEN NOT EXISTS (SELECT 1 FROM audit WHERE seq = NEW.seq AND hash = NEW.hash)
BEGIN SELECT RAISE(ABORT, 'the audit trail begins after one of its rows'); END;

-- When each key was used, by the first digits of its hash; written at most once a minute.
CREATE TABLE key_uses (
    key     TEXT    NOT NULL PRIMARY KEY,
    used_at INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
