-- Addresses that a tenant wants its news sent to.
CREATE TABLE webhooks (
    id         TEXT    NOT NULL PRIMARY KEY,
    tenant     TEXT    NOT NULL,
    url        TEXT    NOT NULL,
    events     TEXT    NOT NULL,                 -- JSON array of their names
    secret     BLOB    NOT NULL,                 -- what messages are signed with
    old_secret BLOB,                             -- the one before it, until old_until
    old_until  INTEGER,
    created_at INTEGER NOT NULL,
    state      TEXT    NOT NULL DEFAULT 'enabled'
               CHECK (state IN ('enabled', 'disabled', 'gone')),
    wait_until INTEGER NOT NULL DEFAULT 0        -- nothing is sent before: the receiver was not there
) STRICT;
CREATE INDEX webhooks_by_tenant ON webhooks (tenant, id);

-- What is to be sent, and what came of it: written in the transaction of what it tells of.
CREATE TABLE deliveries (
    id         TEXT    NOT NULL PRIMARY KEY,     -- the same over all tries
    webhook_id TEXT    NOT NULL REFERENCES webhooks (id) ON DELETE CASCADE,
    tenant     TEXT    NOT NULL,
    event      TEXT    NOT NULL,
    data       TEXT    NOT NULL,                 -- JSON object
    created_at INTEGER NOT NULL,
    due_at     INTEGER,                          -- NULL: it is over
    tries      INTEGER NOT NULL DEFAULT 0,
    tried_at   INTEGER,
    status     INTEGER,                          -- of the last answer
    error      TEXT                              -- why the last try failed; NULL: it did not
) STRICT;
CREATE INDEX deliveries_waiting ON deliveries (webhook_id, due_at, id) WHERE due_at IS NOT NULL;
CREATE INDEX deliveries_by_webhook ON deliveries (webhook_id, id);
CREATE INDEX deliveries_by_age ON deliveries (created_at);
