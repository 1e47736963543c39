-- Erased clouds leave tombstones too, and jobs that outlive their cloud know it.
ALTER TABLE tombstones RENAME COLUMN job_id TO id;

ALTER TABLE jobs ADD COLUMN cloud_erased INTEGER NOT NULL DEFAULT 0 CHECK (cloud_erased IN (0, 1));
UPDATE jobs SET cloud_erased = 1 WHERE cloud_id NOT IN (SELECT id FROM clouds);
