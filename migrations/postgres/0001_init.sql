-- The tables of the service on Postgres: those of SQLite after all its migrations (migrations/*.sql has
-- the reasons), with types that both databases have. Times are milliseconds since the Unix epoch, flags
-- are 0 and 1, JSON columns hold text that the program parses where it reads the row. Texts are compared
-- byte by byte, so that no change of a locale moves a row.

-- What SQLite has and Postgres has not, by the same names, so that statements are one text.
CREATE FUNCTION max(a BIGINT, b BIGINT) RETURNS BIGINT LANGUAGE SQL IMMUTABLE PARALLEL SAFE AS
    'SELECT CASE WHEN a IS NULL OR b IS NULL THEN NULL ELSE GREATEST(a, b) END';
CREATE FUNCTION min(a BIGINT, b BIGINT) RETURNS BIGINT LANGUAGE SQL IMMUTABLE PARALLEL SAFE AS
    'SELECT CASE WHEN a IS NULL OR b IS NULL THEN NULL ELSE LEAST(a, b) END';
-- A member of an object, by a path of one step such as '$.verdict'. The text of U+0000 cannot be kept:
-- U+FFFE, which is no character, stands for it, as in what the program asks for.
CREATE FUNCTION json_extract(document TEXT, path TEXT) RETURNS TEXT
    LANGUAGE SQL IMMUTABLE PARALLEL SAFE AS
    $$SELECT replace(document, '\u0000', '\ufffe')::json ->> substr(path, 3)$$;
CREATE FUNCTION json_each(document TEXT) RETURNS TABLE (key TEXT, value TEXT)
    LANGUAGE SQL IMMUTABLE PARALLEL SAFE AS
    $$SELECT key, value FROM json_each_text(replace(document, '\u0000', '\ufffe')::json)$$;

-- What is known of the database as a whole: its id, by which it finds its objects; as objects the address of
-- the store that has them, if one does; as folder the name in the file "home" of the data folder of its one
-- service.
CREATE TABLE meta (
    name  TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    value TEXT COLLATE "C" NOT NULL
);
INSERT INTO meta (name, value) VALUES ('id', replace(CAST(gen_random_uuid() AS TEXT), '-', ''));

-- Uploaded clouds; the bytes are an object, or the file clouds/<sha256> of the data folder. Two tenants with
-- the same bytes have a cloud each.
CREATE TABLE clouds (
    id         TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    tenant     TEXT COLLATE "C" NOT NULL,
    sha256     TEXT COLLATE "C" NOT NULL,
    bytes      BIGINT NOT NULL CHECK (bytes >= 0),
    format     TEXT COLLATE "C" NOT NULL,
    points     BIGINT NOT NULL CHECK (points >= 0),
    summary    TEXT COLLATE "C" NOT NULL,        -- JSON object
    created_at BIGINT NOT NULL,
    expires_at BIGINT,                           -- NULL: never
    hold       BIGINT NOT NULL DEFAULT 0 CHECK (hold IN (0, 1)),
    object     TEXT COLLATE "C" UNIQUE,           -- NULL: the file
    UNIQUE (tenant, sha256)
);
CREATE INDEX clouds_by_tenant ON clouds (tenant, id);
CREATE INDEX clouds_by_sha256 ON clouds (sha256);
CREATE INDEX clouds_by_end ON clouds (expires_at) WHERE expires_at IS NOT NULL;

CREATE TABLE jobs (
    id               TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    cloud_id         TEXT COLLATE "C" NOT NULL,  -- no foreign key: a job that has ended outlives its cloud
    status           TEXT COLLATE "C" NOT NULL
                     CHECK (status IN ('queued', 'running', 'succeeded', 'failed', 'cancelled')),
    phase            TEXT COLLATE "C",
    preset           TEXT COLLATE "C" NOT NULL,
    settings         TEXT COLLATE "C" NOT NULL,  -- JSON object, complete
    labels           TEXT COLLATE "C" NOT NULL,  -- JSON object of strings
    derived_from     TEXT COLLATE "C",
    created_at       BIGINT NOT NULL,
    started_at       BIGINT,
    finished_at      BIGINT,                     -- set exactly in the final states
    attempt          BIGINT NOT NULL DEFAULT 0,  -- the fence: +1 at every claim
    failures         BIGINT NOT NULL DEFAULT 0,
    failure_reason   TEXT COLLATE "C",           -- JSON object
    worker           TEXT COLLATE "C",           -- set exactly while running
    lease_until      BIGINT,                     -- set exactly while running
    cancel_requested BIGINT NOT NULL DEFAULT 0 CHECK (cancel_requested IN (0, 1)),
    progress         DOUBLE PRECISION NOT NULL DEFAULT 0,
    eta_seconds      DOUBLE PRECISION,
    evaluations      BIGINT NOT NULL DEFAULT 0,
    loss             DOUBLE PRECISION,
    error            TEXT COLLATE "C",           -- JSON object; set exactly when failed
    report           TEXT COLLATE "C",           -- JSON object; set exactly when succeeded
    events           BIGINT NOT NULL DEFAULT 0,  -- id of the newest event
    metrics          BIGINT NOT NULL DEFAULT 0,  -- number of rows in metrics
    cloud_erased     BIGINT NOT NULL DEFAULT 0 CHECK (cloud_erased IN (0, 1)),
    worked_ms        BIGINT NOT NULL DEFAULT 0 CHECK (worked_ms >= 0),
    source           TEXT COLLATE "C",           -- JSON object, or NULL for the whole file
    tenant           TEXT COLLATE "C" NOT NULL DEFAULT 'default',
    priority         BIGINT NOT NULL DEFAULT 0,
    cost_ms          BIGINT NOT NULL DEFAULT 10000 CHECK (cost_ms >= 1),
    account          TEXT COLLATE "C" NOT NULL DEFAULT '',
    counted_at       BIGINT,
    keep_ms          BIGINT CHECK (keep_ms > 0),
    once             BIGINT NOT NULL DEFAULT 0 CHECK (once IN (0, 1)),
    expires_at       BIGINT,
    hold             BIGINT NOT NULL DEFAULT 0 CHECK (hold IN (0, 1)),
    batch_id         TEXT COLLATE "C",
    CHECK ((finished_at IS NOT NULL) = (status IN ('succeeded', 'failed', 'cancelled'))),
    CHECK ((worker IS NOT NULL) = (status = 'running')),
    CHECK ((lease_until IS NOT NULL) = (status = 'running')),
    CHECK ((error IS NOT NULL) = (status = 'failed')),
    CHECK ((report IS NOT NULL) = (status = 'succeeded'))
) WITH (fillfactor = 70, autovacuum_vacuum_scale_factor = 0.02, autovacuum_analyze_scale_factor = 0.02);
CREATE INDEX jobs_by_status ON jobs (status, created_at, id);
CREATE INDEX jobs_by_cloud ON jobs (cloud_id, id);
CREATE INDEX jobs_by_tenant ON jobs (tenant, id);
CREATE INDEX jobs_by_verdict ON jobs (tenant, json_extract(report, '$.verdict'), id)
    WHERE report IS NOT NULL;
CREATE INDEX jobs_by_end ON jobs (expires_at) WHERE expires_at IS NOT NULL;
CREATE INDEX jobs_by_batch ON jobs (batch_id, id) WHERE batch_id IS NOT NULL;
CREATE INDEX jobs_waiting ON jobs (tenant, priority DESC, created_at, id, cost_ms, status)
    WHERE status = 'queued';

-- The numbers of all events are in the order of the commits, because one transaction writes at a time.
CREATE TABLE events (
    seq     BIGINT GENERATED BY DEFAULT AS IDENTITY PRIMARY KEY,
    job_id  TEXT COLLATE "C" NOT NULL REFERENCES jobs (id),
    id      BIGINT NOT NULL CHECK (id >= 1),
    event   TEXT COLLATE "C" NOT NULL,
    time    BIGINT NOT NULL,
    attempt BIGINT NOT NULL,
    data    TEXT COLLATE "C" NOT NULL,           -- JSON object
    tenant  TEXT COLLATE "C" NOT NULL DEFAULT 'default',
    UNIQUE (job_id, id)
);
CREATE INDEX events_by_tenant ON events (tenant, seq);

CREATE TABLE metrics (
    job_id          TEXT COLLATE "C" NOT NULL REFERENCES jobs (id),
    evaluation      BIGINT NOT NULL,
    iteration       BIGINT NOT NULL,
    loss            DOUBLE PRECISION,            -- NULL: not a number
    validation_loss DOUBLE PRECISION,
    gradient_norm   DOUBLE PRECISION,
    step_length     DOUBLE PRECISION,
    weight_norms    BYTEA NOT NULL,              -- f64, little-endian, one a layer
    blocks          BIGINT,
    PRIMARY KEY (job_id, evaluation)
);

CREATE TABLE gradients (
    job_id     TEXT COLLATE "C" NOT NULL REFERENCES jobs (id),
    evaluation BIGINT NOT NULL,
    data       TEXT COLLATE "C" NOT NULL,        -- JSON array, one object a layer
    PRIMARY KEY (job_id, evaluation)
);

-- Meshes, models and checkpoints name their bytes by the key of an object.
CREATE TABLE meshes (
    id         BIGINT GENERATED BY DEFAULT AS IDENTITY PRIMARY KEY,
    job_id     TEXT COLLATE "C" NOT NULL REFERENCES jobs (id),
    evaluation BIGINT NOT NULL CHECK (evaluation >= 0),
    vertices   BIGINT NOT NULL,
    triangles  BIGINT NOT NULL,
    bytes      BIGINT NOT NULL,
    sha256     TEXT COLLATE "C" NOT NULL,
    created_at BIGINT NOT NULL,
    object     TEXT COLLATE "C" UNIQUE,
    verdict    TEXT COLLATE "C" CHECK (verdict IN ('good', 'doubtful', 'poor')),
    UNIQUE (job_id, evaluation)
);

CREATE TABLE models (
    job_id TEXT COLLATE "C" NOT NULL PRIMARY KEY REFERENCES jobs (id),
    object TEXT COLLATE "C" NOT NULL UNIQUE,
    bytes  BIGINT NOT NULL,
    sha256 TEXT COLLATE "C" NOT NULL
);

CREATE TABLE checkpoints (
    job_id     TEXT COLLATE "C" NOT NULL PRIMARY KEY REFERENCES jobs (id),
    attempt    BIGINT NOT NULL,
    evaluation BIGINT NOT NULL,
    object     TEXT COLLATE "C" NOT NULL UNIQUE,
    bytes      BIGINT NOT NULL,
    created_at BIGINT NOT NULL
);

CREATE TABLE graves (
    key TEXT COLLATE "C" NOT NULL PRIMARY KEY
);

CREATE TABLE refused (
    key TEXT COLLATE "C" NOT NULL PRIMARY KEY
);

CREATE TABLE idempotency (
    tenant         TEXT COLLATE "C" NOT NULL,
    key            TEXT COLLATE "C" NOT NULL,
    scope          TEXT COLLATE "C" NOT NULL,
    request_sha256 TEXT COLLATE "C" NOT NULL,
    job_id         TEXT COLLATE "C",
    cloud_id       TEXT COLLATE "C",
    status         BIGINT,                       -- NULL while the first is in flight
    headers        TEXT COLLATE "C" NOT NULL DEFAULT '[]',
    body           BYTEA NOT NULL DEFAULT '',
    created_at     BIGINT NOT NULL,
    batch_id       TEXT COLLATE "C",
    PRIMARY KEY (tenant, key, scope)
);
CREATE INDEX idempotency_by_age ON idempotency (created_at);
CREATE INDEX idempotency_by_job ON idempotency (job_id);
CREATE INDEX idempotency_by_cloud ON idempotency (cloud_id);

CREATE TABLE tombstones (
    id         TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    deleted_at BIGINT NOT NULL,
    reason     TEXT COLLATE "C" NOT NULL,
    tenant     TEXT COLLATE "C" NOT NULL DEFAULT 'default'
);

CREATE TABLE audit (
    seq     BIGINT NOT NULL PRIMARY KEY,         -- 1, 2, 3, … without a gap
    at      BIGINT NOT NULL,
    tenant  TEXT COLLATE "C",
    actor   TEXT COLLATE "C",
    key     TEXT COLLATE "C",
    address TEXT COLLATE "C",
    action  TEXT COLLATE "C" NOT NULL CHECK (action IN ('C', 'R', 'U', 'D', 'E')),
    event   TEXT COLLATE "C" NOT NULL,
    object  TEXT COLLATE "C" NOT NULL,
    outcome BIGINT NOT NULL CHECK (outcome IN (0, 4, 8, 12)),
    request TEXT COLLATE "C" NOT NULL,
    hash    TEXT COLLATE "C" NOT NULL
);
CREATE INDEX audit_by_tenant ON audit (tenant, seq);
CREATE INDEX audit_by_age ON audit (at);

CREATE TABLE audit_begins (
    seq  BIGINT NOT NULL PRIMARY KEY,
    hash TEXT COLLATE "C" NOT NULL
);

-- The largest place that was given: rows that are cut off at the end show against it.
CREATE TABLE audit_given (
    one  BIGINT NOT NULL PRIMARY KEY CHECK (one = 1),
    seq  BIGINT NOT NULL
);

CREATE FUNCTION audit_refuse() RETURNS trigger LANGUAGE plpgsql AS
    $$BEGIN RAISE EXCEPTION '%', TG_ARGV[0]; END$$;
CREATE FUNCTION audit_may_remove() RETURNS trigger LANGUAGE plpgsql AS
    $$BEGIN
        IF OLD.seq > COALESCE((SELECT max(seq) FROM audit_begins), 0) THEN
            RAISE EXCEPTION 'the audit trail is not removed';
        END IF;
        RETURN OLD;
    END$$;
CREATE FUNCTION audit_may_begin() RETURNS trigger LANGUAGE plpgsql AS
    $$BEGIN
        IF NOT EXISTS (SELECT 1 FROM audit WHERE seq = NEW.seq AND hash = NEW.hash) THEN
            RAISE EXCEPTION 'the audit trail begins after one of its rows';
        END IF;
        RETURN NEW;
    END$$;
CREATE FUNCTION audit_give() RETURNS trigger LANGUAGE plpgsql AS
    $$BEGIN
        INSERT INTO audit_given (one, seq) VALUES (1, NEW.seq)
        ON CONFLICT (one) DO UPDATE SET seq = max(audit_given.seq, excluded.seq);
        RETURN NEW;
    END$$;
CREATE TRIGGER audit_is_not_changed BEFORE UPDATE ON audit
    FOR EACH ROW EXECUTE FUNCTION audit_refuse('the audit trail is not changed');
CREATE TRIGGER audit_is_not_emptied BEFORE TRUNCATE ON audit
    FOR EACH STATEMENT EXECUTE FUNCTION audit_refuse('the audit trail is not removed');
CREATE TRIGGER audit_is_not_removed BEFORE DELETE ON audit
    FOR EACH ROW EXECUTE FUNCTION audit_may_remove();
CREATE TRIGGER audit_begins_with_what_is_there BEFORE INSERT ON audit_begins
    FOR EACH ROW EXECUTE FUNCTION audit_may_begin();
CREATE TRIGGER audit_numbers_are_given BEFORE INSERT ON audit
    FOR EACH ROW EXECUTE FUNCTION audit_give();

CREATE TABLE key_uses (
    key     TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    used_at BIGINT NOT NULL
);

CREATE TABLE keys (
    id         TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    hash       TEXT COLLATE "C" NOT NULL UNIQUE,
    name       TEXT COLLATE "C" NOT NULL,
    tenant     TEXT COLLATE "C" NOT NULL,
    scopes     TEXT COLLATE "C" NOT NULL,
    networks   TEXT COLLATE "C" NOT NULL,
    limits     TEXT COLLATE "C" NOT NULL,
    expires    BIGINT,
    created_at BIGINT NOT NULL,
    UNIQUE (tenant, name)
);

CREATE TABLE turns (
    tenant    TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    served_ms BIGINT NOT NULL CHECK (served_ms >= 0)
);
CREATE TABLE now_served (
    one  BIGINT NOT NULL PRIMARY KEY CHECK (one = 1),
    turn BIGINT NOT NULL CHECK (turn >= 0)
);
INSERT INTO now_served VALUES (1, 0);

-- How many jobs wait, and their estimated work, in sums; no row where none waits.
CREATE TABLE waiting (
    tenant   TEXT COLLATE "C" NOT NULL,
    priority BIGINT NOT NULL,
    jobs     BIGINT NOT NULL CHECK (jobs >= 0),
    cost_ms  BIGINT NOT NULL CHECK (cost_ms >= 0),
    PRIMARY KEY (tenant, priority)
) WITH (fillfactor = 50);
CREATE FUNCTION job_waits() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    IF TG_OP <> 'INSERT' AND OLD.status = 'queued' THEN
        UPDATE waiting SET jobs = jobs - 1, cost_ms = cost_ms - OLD.cost_ms
            WHERE tenant = OLD.tenant AND priority = OLD.priority;
        DELETE FROM waiting WHERE tenant = OLD.tenant AND priority = OLD.priority AND jobs = 0;
    END IF;
    IF TG_OP <> 'DELETE' AND NEW.status = 'queued' THEN
        INSERT INTO waiting VALUES (NEW.tenant, NEW.priority, 1, NEW.cost_ms)
            ON CONFLICT (tenant, priority) DO UPDATE
            SET jobs = waiting.jobs + 1, cost_ms = waiting.cost_ms + excluded.cost_ms;
    END IF;
    RETURN NULL;
END
$$;
CREATE TRIGGER jobs_wait AFTER INSERT OR UPDATE OF status, tenant, priority, cost_ms OR DELETE ON jobs
    FOR EACH ROW EXECUTE FUNCTION job_waits();

-- ORDER BY turn, created_at, id is the order in which jobs are claimed.
CREATE VIEW queue AS
    SELECT id, tenant, created_at, cost_ms,
           max(COALESCE((SELECT served_ms FROM turns WHERE turns.tenant = jobs.tenant), 0),
               (SELECT turn FROM now_served))
           + CAST(SUM(cost_ms) OVER (PARTITION BY tenant ORDER BY priority DESC, created_at, id
                                     ROWS UNBOUNDED PRECEDING) AS BIGINT)
           - cost_ms AS turn
    FROM jobs WHERE status = 'queued';

CREATE TABLE compute (
    day     BIGINT NOT NULL,
    tenant  TEXT COLLATE "C" NOT NULL,
    account TEXT COLLATE "C" NOT NULL,
    ms      BIGINT NOT NULL CHECK (ms >= 0),
    PRIMARY KEY (day, tenant, account)
);

CREATE TABLE uploads (
    id                 TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    tenant             TEXT COLLATE "C" NOT NULL,
    length             BIGINT CHECK (length >= 0),
    bytes              BIGINT NOT NULL DEFAULT 0 CHECK (bytes >= 0),
    complete           BIGINT NOT NULL DEFAULT 0 CHECK (complete IN (0, 1)),
    format             TEXT COLLATE "C",
    assume_orientation BIGINT NOT NULL DEFAULT 0 CHECK (assume_orientation IN (0, 1)),
    cloud_id           TEXT COLLATE "C",
    error              TEXT COLLATE "C",
    created_at         BIGINT NOT NULL,
    expires_at         BIGINT NOT NULL,
    CHECK (cloud_id IS NULL OR error IS NULL),
    CHECK (complete = 1 OR (cloud_id IS NULL AND error IS NULL))
);
CREATE INDEX uploads_by_tenant ON uploads (tenant, id);
CREATE INDEX uploads_by_end ON uploads (expires_at);

CREATE TABLE batches (
    id         TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    tenant     TEXT COLLATE "C" NOT NULL,
    made       BIGINT NOT NULL CHECK (made >= 1),
    progress   DOUBLE PRECISION NOT NULL DEFAULT 0,
    created_at BIGINT NOT NULL
);
CREATE INDEX batches_by_tenant ON batches (tenant, id);

-- Mean over the jobs; one that has ended or was erased counts as done.
CREATE VIEW batch_states AS
    SELECT batches.id, batches.tenant, batches.made, batches.created_at,
           GREATEST(batches.progress,
               1 - (SELECT COALESCE(SUM(1 - jobs.progress), 0) FROM jobs
                    WHERE jobs.batch_id = batches.id AND finished_at IS NULL) / batches.made)
           AS progress
    FROM batches;

-- A job that is worked on anew begins at 0; its batch does not go back with it. The trigger comes before
-- the change, so that it still sees what the batch had.
CREATE FUNCTION batch_stays() RETURNS trigger LANGUAGE plpgsql AS
    $$BEGIN
        UPDATE batches SET progress =
            (SELECT progress FROM batch_states WHERE batch_states.id = NEW.batch_id)
        WHERE id = NEW.batch_id;
        RETURN NEW;
    END$$;
CREATE TRIGGER batches_do_not_go_back BEFORE UPDATE OF progress ON jobs
    FOR EACH ROW WHEN (NEW.batch_id IS NOT NULL AND NEW.progress < OLD.progress)
    EXECUTE FUNCTION batch_stays();

CREATE TABLE webhooks (
    id         TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    tenant     TEXT COLLATE "C" NOT NULL,
    url        TEXT COLLATE "C" NOT NULL,
    events     TEXT COLLATE "C" NOT NULL,        -- JSON array of their names
    secret     BYTEA NOT NULL,
    old_secret BYTEA,
    old_until  BIGINT,
    created_at BIGINT NOT NULL,
    state      TEXT COLLATE "C" NOT NULL DEFAULT 'enabled'
               CHECK (state IN ('enabled', 'disabled', 'gone')),
    wait_until BIGINT NOT NULL DEFAULT 0
);
CREATE INDEX webhooks_by_tenant ON webhooks (tenant, id);

CREATE TABLE deliveries (
    id         TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    webhook_id TEXT COLLATE "C" NOT NULL REFERENCES webhooks (id) ON DELETE CASCADE,
    tenant     TEXT COLLATE "C" NOT NULL,
    event      TEXT COLLATE "C" NOT NULL,
    data       TEXT COLLATE "C" NOT NULL,        -- JSON object
    created_at BIGINT NOT NULL,
    due_at     BIGINT,                           -- NULL: it is over
    tries      BIGINT NOT NULL DEFAULT 0,
    tried_at   BIGINT,
    status     BIGINT,
    error      TEXT COLLATE "C"
);
CREATE INDEX deliveries_waiting ON deliveries (webhook_id, due_at, id) WHERE due_at IS NOT NULL;
CREATE INDEX deliveries_by_webhook ON deliveries (webhook_id, id);
CREATE INDEX deliveries_by_age ON deliveries (created_at);
