-- Jobs by the verdict in their report, which is nowhere else; null in reports of earlier versions.
CREATE INDEX jobs_by_verdict ON jobs (json_extract(report, '$.verdict'), id) WHERE report IS NOT NULL;
