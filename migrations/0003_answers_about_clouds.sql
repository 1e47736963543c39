-- A kept answer that tells of a cloud goes with the cloud, as one that tells of a job with the job.
ALTER TABLE idempotency ADD COLUMN cloud_id TEXT;    -- the cloud that was uploaded
CREATE INDEX idempotency_by_cloud ON idempotency (cloud_id);

UPDATE idempotency SET cloud_id = json_extract(CAST(body AS TEXT), '$.id')
 WHERE scope = 'POST /v1/clouds' AND status IS NOT NULL AND json_valid(CAST(body AS TEXT));
UPDATE idempotency SET headers = '[]', body = x''
 WHERE cloud_id NOT IN (SELECT id FROM clouds);
