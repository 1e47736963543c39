-- The bytes of meshes, models and checkpoints are objects in content.db; these rows name them. A
-- key is made once and named by at most one row. What databases from before hold is moved by the
-- program when it opens them, which then drops mesh_chunks, models_before and checkpoints_before.
ALTER TABLE meshes ADD COLUMN object TEXT;       -- key of the bytes; NULL until they are moved
CREATE UNIQUE INDEX meshes_by_object ON meshes (object);

ALTER TABLE models RENAME TO models_before;
CREATE TABLE models (
    job_id TEXT    NOT NULL PRIMARY KEY REFERENCES jobs (id),
    object TEXT    NOT NULL UNIQUE,              -- safetensors
    bytes  INTEGER NOT NULL,
    sha256 TEXT    NOT NULL                      -- of the object, lower-case hexadecimal
) STRICT;

ALTER TABLE checkpoints RENAME TO checkpoints_before;
CREATE TABLE checkpoints (
    job_id     TEXT    NOT NULL PRIMARY KEY REFERENCES jobs (id),
    attempt    INTEGER NOT NULL,                 -- that wrote it
    evaluation INTEGER NOT NULL,                 -- at which it was taken
    object     TEXT    NOT NULL UNIQUE,
    bytes      INTEGER NOT NULL,
    created_at INTEGER NOT NULL
) STRICT;

-- Keys that no row names any more: their bytes are to be removed.
CREATE TABLE graves (
    key TEXT NOT NULL PRIMARY KEY
) STRICT, WITHOUT ROWID;

-- Keys that were taken for garbage before a row named them: none may name them later.
CREATE TABLE refused (
    key TEXT NOT NULL PRIMARY KEY
) STRICT, WITHOUT ROWID;
