-- How many jobs wait, and their estimated work, in sums: a submit is told its place and is refused by
-- a full queue, and neither may cost more the more jobs wait. The triggers keep the sums, so that no
-- statement can forget them. Whoever builds `jobs` anew makes the triggers again.
CREATE TABLE waiting (
    tenant   TEXT    NOT NULL,
    priority INTEGER NOT NULL,
    jobs     INTEGER NOT NULL CHECK (jobs >= 0),
    cost_ms  INTEGER NOT NULL CHECK (cost_ms >= 0),
    PRIMARY KEY (tenant, priority)               -- no row where none waits
) STRICT, WITHOUT ROWID;
INSERT INTO waiting
    SELECT tenant, priority, COUNT(*), SUM(cost_ms) FROM jobs WHERE status = 'queued' GROUP BY tenant, priority;

CREATE TRIGGER job_begins_to_wait AFTER INSERT ON jobs WHEN NEW.status = 'queued' BEGIN
    INSERT INTO waiting VALUES (NEW.tenant, NEW.priority, 1, NEW.cost_ms)
        ON CONFLICT DO UPDATE SET jobs = jobs + 1, cost_ms = cost_ms + excluded.cost_ms;
END;
CREATE TRIGGER job_waits_anew AFTER UPDATE OF status, tenant, priority, cost_ms ON jobs WHEN NEW.status = 'queued' BEGIN
    INSERT INTO waiting VALUES (NEW.tenant, NEW.priority, 1, NEW.cost_ms)
        ON CONFLICT DO UPDATE SET jobs = jobs + 1, cost_ms = cost_ms + excluded.cost_ms;
END;
CREATE TRIGGER job_waited AFTER UPDATE OF status, tenant, priority, cost_ms ON jobs WHEN OLD.status = 'queued' BEGIN
    UPDATE waiting SET jobs = jobs - 1, cost_ms = cost_ms - OLD.cost_ms
        WHERE tenant = OLD.tenant AND priority = OLD.priority;
    DELETE FROM waiting WHERE tenant = OLD.tenant AND priority = OLD.priority AND jobs = 0;
END;
CREATE TRIGGER job_waits_no_more AFTER DELETE ON jobs WHEN OLD.status = 'queued' BEGIN
    UPDATE waiting SET jobs = jobs - 1, cost_ms = cost_ms - OLD.cost_ms
        WHERE tenant = OLD.tenant AND priority = OLD.priority;
    DELETE FROM waiting WHERE tenant = OLD.tenant AND priority = OLD.priority AND jobs = 0;
END;
