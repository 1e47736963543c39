-- Keys that the API made, beside those of the file. Revoked ones are removed; the audit trail has both.
CREATE TABLE keys (
    id         TEXT    NOT NULL PRIMARY KEY,     -- first 8 digits of the hash
    hash       TEXT    NOT NULL UNIQUE,          -- sha256: and 64 digits; the key itself is nowhere
    name       TEXT    NOT NULL,
    tenant     TEXT    NOT NULL,
    scopes     TEXT    NOT NULL,                 -- JSON array of names
    networks   TEXT    NOT NULL,                 -- JSON array of networks; empty: all
    limits     TEXT    NOT NULL,                 -- JSON object
    expires    INTEGER,
    created_at INTEGER NOT NULL,
    UNIQUE (tenant, name)
) STRICT, WITHOUT ROWID;
