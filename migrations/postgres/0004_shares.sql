-- As migrations/0022_shares.sql.
CREATE TABLE shares (
    job_id     TEXT COLLATE "C" NOT NULL REFERENCES jobs (id),
    share      BIGINT NOT NULL CHECK (share >= 0),
    attempt    BIGINT NOT NULL,
    processor  TEXT COLLATE "C" NOT NULL,
    object     TEXT COLLATE "C" NOT NULL UNIQUE,
    bytes      BIGINT NOT NULL CHECK (bytes >= 0),
    helper     TEXT COLLATE "C",
    fitted     BIGINT NOT NULL DEFAULT 0 CHECK (fitted IN (0, 1)),
    created_at BIGINT NOT NULL,
    PRIMARY KEY (job_id, share)
);
CREATE INDEX shares_open ON shares (created_at, job_id, share) WHERE helper IS NULL;
