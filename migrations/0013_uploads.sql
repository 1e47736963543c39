-- Uploads that may go on after they were cut. The bytes so far are the file uploads/<id> of the data
-- folder; what the file has beyond them was not told to anybody and is not counted.
CREATE TABLE uploads (
    id                 TEXT    NOT NULL PRIMARY KEY,
    tenant             TEXT    NOT NULL,
    length             INTEGER CHECK (length >= 0),       -- of all bytes; NULL while it is not known
    bytes              INTEGER NOT NULL DEFAULT 0 CHECK (bytes >= 0), -- those that are on the disk
    complete           INTEGER NOT NULL DEFAULT 0 CHECK (complete IN (0, 1)),
    format             TEXT,                              -- what its name says; NULL: nothing
    assume_orientation INTEGER NOT NULL DEFAULT 0 CHECK (assume_orientation IN (0, 1)),
    cloud_id           TEXT,                              -- what became of it: a cloud,
    error              TEXT,                              -- or a problem, a JSON object
    created_at         INTEGER NOT NULL,
    expires_at         INTEGER NOT NULL,
    CHECK (cloud_id IS NULL OR error IS NULL),
    CHECK (complete = 1 OR (cloud_id IS NULL AND error IS NULL))
) STRICT;
CREATE INDEX uploads_by_tenant ON uploads (tenant, id);
CREATE INDEX uploads_by_end ON uploads (expires_at);
