-- When clouds and jobs are erased by themselves, and which are not to be erased. NULL: never; what was
-- there before stays until somebody erases it.
ALTER TABLE clouds ADD COLUMN expires_at INTEGER;
ALTER TABLE clouds ADD COLUMN hold INTEGER NOT NULL DEFAULT 0 CHECK (hold IN (0, 1));
CREATE INDEX clouds_by_end ON clouds (expires_at) WHERE expires_at IS NOT NULL;

ALTER TABLE jobs ADD COLUMN keep_ms INTEGER CHECK (keep_ms > 0); -- after its end; NULL: for ever
ALTER TABLE jobs ADD COLUMN once INTEGER NOT NULL DEFAULT 0 CHECK (once IN (0, 1)); -- goes once its mesh was fetched
ALTER TABLE jobs ADD COLUMN expires_at INTEGER;                  -- set when it ends
ALTER TABLE jobs ADD COLUMN hold INTEGER NOT NULL DEFAULT 0 CHECK (hold IN (0, 1));
CREATE INDEX jobs_by_end ON jobs (expires_at) WHERE expires_at IS NOT NULL;
