-- As migrations/0020_nodes.sql.
CREATE TABLE nodes (
    name       TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    host       TEXT COLLATE "C" NOT NULL,
    role       TEXT COLLATE "C" NOT NULL CHECK (role IN ('serve', 'worker')),
    version    TEXT COLLATE "C" NOT NULL,
    slots      BIGINT NOT NULL CHECK (slots >= 0),
    started_at BIGINT NOT NULL,
    seen_at    BIGINT NOT NULL
);

CREATE TABLE duties (
    name TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    node TEXT COLLATE "C" NOT NULL,
    ends BIGINT NOT NULL
);

ALTER TABLE idempotency ADD COLUMN node TEXT COLLATE "C" NOT NULL DEFAULT '';

CREATE TABLE sessions (
    hash      TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    user_name TEXT COLLATE "C" NOT NULL,
    password  TEXT COLLATE "C" NOT NULL,
    began_at  BIGINT NOT NULL,
    used_at   BIGINT NOT NULL
);
CREATE INDEX sessions_by_use ON sessions (used_at);

CREATE TABLE upload_parts (
    upload_id TEXT COLLATE "C" NOT NULL REFERENCES uploads (id),
    at        BIGINT NOT NULL CHECK (at >= 0),
    bytes     BIGINT NOT NULL CHECK (bytes > 0),
    object    TEXT COLLATE "C" NOT NULL UNIQUE,
    PRIMARY KEY (upload_id, at)
);

CREATE INDEX tombstones_by_time ON tombstones (deleted_at);

-- The last commit of each process that writes. It asks for it when the answer to one was lost: a number of a
-- transaction can be given again after the server died.
CREATE TABLE writers (
    name    TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    commits BIGINT NOT NULL,
    at      BIGINT NOT NULL
) WITH (fillfactor = 50);
