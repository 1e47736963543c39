-- Jobs that are inserted by one statement are counted by one: as many updates of the same sums would each
-- have to pass the versions of the rows that those before it left.
CREATE FUNCTION jobs_come() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    INSERT INTO waiting (tenant, priority, jobs, cost_ms)
        SELECT tenant, priority, COUNT(*), CAST(SUM(cost_ms) AS BIGINT)
        FROM come WHERE status = 'queued' GROUP BY tenant, priority
        ON CONFLICT (tenant, priority) DO UPDATE
        SET jobs = waiting.jobs + excluded.jobs, cost_ms = waiting.cost_ms + excluded.cost_ms;
    INSERT INTO totals (tenant, status, jobs)
        SELECT tenant, status, COUNT(*) FROM come GROUP BY tenant, status
        ON CONFLICT (tenant, status) DO UPDATE SET jobs = totals.jobs + excluded.jobs;
    RETURN NULL;
END
$$;
CREATE TRIGGER jobs_come AFTER INSERT ON jobs
    REFERENCING NEW TABLE AS come FOR EACH STATEMENT EXECUTE FUNCTION jobs_come();

DROP TRIGGER jobs_wait ON jobs;
CREATE TRIGGER jobs_wait AFTER UPDATE OF status, tenant, priority, cost_ms OR DELETE ON jobs
    FOR EACH ROW EXECUTE FUNCTION job_waits();
DROP TRIGGER jobs_count ON jobs;
CREATE TRIGGER jobs_count AFTER UPDATE OF status, tenant OR DELETE ON jobs
    FOR EACH ROW EXECUTE FUNCTION job_counts();
