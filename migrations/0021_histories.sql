-- What a job told while it ran (events, series, histograms), as one object some time after its end; its rows
-- are gone then. The store reads either (records/history.rs).
CREATE TABLE histories (
    job_id    TEXT    NOT NULL PRIMARY KEY REFERENCES jobs (id),
    tenant    TEXT    NOT NULL,
    object    TEXT    NOT NULL UNIQUE,
    bytes     INTEGER NOT NULL CHECK (bytes >= 0),
    first_seq INTEGER NOT NULL,                  -- of its events among those of all jobs
    last_seq  INTEGER NOT NULL CHECK (last_seq >= first_seq)
) STRICT, WITHOUT ROWID;
CREATE INDEX histories_by_end ON histories (tenant, last_seq);

ALTER TABLE jobs ADD COLUMN archived INTEGER NOT NULL DEFAULT 0 CHECK (archived IN (0, 1));
CREATE INDEX jobs_to_archive ON jobs (finished_at) WHERE archived = 0 AND finished_at IS NOT NULL;

-- How many jobs are in each state: to count them takes the longer the more have ended. Whoever builds `jobs`
-- anew makes the triggers again.
CREATE TABLE totals (
    tenant TEXT    NOT NULL,
    status TEXT    NOT NULL,
    jobs   INTEGER NOT NULL CHECK (jobs >= 0),
    PRIMARY KEY (tenant, status)                 -- no row where there is none
) STRICT, WITHOUT ROWID;
INSERT INTO totals SELECT tenant, status, COUNT(*) FROM jobs GROUP BY tenant, status;

CREATE TRIGGER job_counts AFTER INSERT ON jobs BEGIN
    INSERT INTO totals VALUES (NEW.tenant, NEW.status, 1)
        ON CONFLICT DO UPDATE SET jobs = jobs + 1;
END;
CREATE TRIGGER job_counts_elsewhere AFTER UPDATE OF status, tenant ON jobs
    WHEN OLD.status <> NEW.status OR OLD.tenant <> NEW.tenant BEGIN
    UPDATE totals SET jobs = jobs - 1 WHERE tenant = OLD.tenant AND status = OLD.status;
    DELETE FROM totals WHERE tenant = OLD.tenant AND status = OLD.status AND jobs = 0;
    INSERT INTO totals VALUES (NEW.tenant, NEW.status, 1)
        ON CONFLICT DO UPDATE SET jobs = jobs + 1;
END;
CREATE TRIGGER job_counts_no_more AFTER DELETE ON jobs BEGIN
    UPDATE totals SET jobs = jobs - 1 WHERE tenant = OLD.tenant AND status = OLD.status;
    DELETE FROM totals WHERE tenant = OLD.tenant AND status = OLD.status AND jobs = 0;
END;

-- Labels of jobs, to find the few that carry one among many.
CREATE TABLE job_labels (
    tenant TEXT NOT NULL,
    key    TEXT NOT NULL,
    value  TEXT NOT NULL,
    job_id TEXT NOT NULL REFERENCES jobs (id),
    PRIMARY KEY (tenant, key, value, job_id)
) STRICT, WITHOUT ROWID;
CREATE INDEX job_labels_by_job ON job_labels (job_id);
INSERT INTO job_labels SELECT jobs.tenant, json_each.key, json_each.value, jobs.id FROM jobs, json_each(jobs.labels);

CREATE INDEX jobs_by_state ON jobs (tenant, status, id);
