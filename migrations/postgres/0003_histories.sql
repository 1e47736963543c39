-- As migrations/0021_histories.sql.
CREATE TABLE histories (
    job_id    TEXT COLLATE "C" NOT NULL PRIMARY KEY REFERENCES jobs (id),
    tenant    TEXT COLLATE "C" NOT NULL,
    object    TEXT COLLATE "C" NOT NULL UNIQUE,
    bytes     BIGINT NOT NULL CHECK (bytes >= 0),
    first_seq BIGINT NOT NULL,
    last_seq  BIGINT NOT NULL CHECK (last_seq >= first_seq)
);
CREATE INDEX histories_by_end ON histories (tenant, last_seq);

ALTER TABLE jobs ADD COLUMN archived BIGINT NOT NULL DEFAULT 0 CHECK (archived IN (0, 1));
CREATE INDEX jobs_to_archive ON jobs (finished_at) WHERE archived = 0 AND finished_at IS NOT NULL;

CREATE TABLE totals (
    tenant TEXT COLLATE "C" NOT NULL,
    status TEXT COLLATE "C" NOT NULL,
    jobs   BIGINT NOT NULL CHECK (jobs >= 0),
    PRIMARY KEY (tenant, status)
);
INSERT INTO totals SELECT tenant, status, COUNT(*) FROM jobs GROUP BY tenant, status;

CREATE FUNCTION job_counts() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    IF TG_OP = 'UPDATE' AND OLD.status = NEW.status AND OLD.tenant = NEW.tenant THEN
        RETURN NULL;
    END IF;
    IF TG_OP <> 'INSERT' THEN
        UPDATE totals SET jobs = jobs - 1 WHERE tenant = OLD.tenant AND status = OLD.status;
        DELETE FROM totals WHERE tenant = OLD.tenant AND status = OLD.status AND jobs = 0;
    END IF;
    IF TG_OP <> 'DELETE' THEN
        INSERT INTO totals VALUES (NEW.tenant, NEW.status, 1)
            ON CONFLICT (tenant, status) DO UPDATE SET jobs = totals.jobs + 1;
    END IF;
    RETURN NULL;
END $$;
CREATE TRIGGER jobs_count AFTER INSERT OR UPDATE OF status, tenant OR DELETE ON jobs
    FOR EACH ROW EXECUTE FUNCTION job_counts();

CREATE TABLE job_labels (
    tenant TEXT COLLATE "C" NOT NULL,
    key    TEXT COLLATE "C" NOT NULL,
    value  TEXT COLLATE "C" NOT NULL,
    job_id TEXT COLLATE "C" NOT NULL REFERENCES jobs (id),
    PRIMARY KEY (tenant, key, value, job_id)
);
CREATE INDEX job_labels_by_job ON job_labels (job_id);
INSERT INTO job_labels SELECT jobs.tenant, label.key, label.value, jobs.id
    FROM jobs, json_each(jobs.labels) AS label;

CREATE INDEX jobs_by_state ON jobs (tenant, status, id);
