#!/usr/bin/env python3
"""How long lists and gets take with very many ended jobs: `make bench-many JOBS=10000000`.

Starts a service over the database of MESHWAY_TEST_DATABASE (scripts/postgres.sh), has it end one job, and
copies its row as often as asked, past the service. Then it asks as clients do, and prints a table: median, 99th
part of a hundred, and the longest of 200 requests of each kind, in milliseconds.
"""

import json
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench_service import Service, sphere

ASKED = 200

# Copies of the one job: a second apart, so that their names are in the order of their times. Of a hundred one
# carries a rare label, one failed, and each has the label of its day.
FILL = """
SET session_replication_role = replica;
SET synchronous_commit = off;
CREATE TEMP TABLE one AS SELECT * FROM jobs LIMIT 1;
INSERT INTO jobs SELECT (json_populate_record(NULL::jobs, row_to_json(one)::json)).* FROM one WHERE false;
DO $$
DECLARE columns TEXT;
BEGIN
  SELECT string_agg(CASE column_name
      WHEN 'id' THEN '''job_'' || lpad(to_hex(t.at), 12, ''0'') || ''7000'' || lpad(to_hex(t.n::BIGINT), 16, ''0'')'
      WHEN 'created_at' THEN 't.at'
      WHEN 'finished_at' THEN 't.at + 900'
      WHEN 'archived' THEN '1'
      WHEN 'events' THEN '0'
      WHEN 'metrics' THEN '0'
      WHEN 'status' THEN 'CASE WHEN t.n % 100 = 7 THEN ''cancelled'' ELSE one.status END'
      WHEN 'report' THEN 'CASE WHEN t.n % 100 = 7 THEN NULL ELSE one.report END'
      ELSE 'one.' || quote_ident(column_name) END, ', ' ORDER BY ordinal_position)
  INTO columns FROM information_schema.columns WHERE table_name = 'jobs' AND table_schema = 'public';
  EXECUTE 'INSERT INTO jobs SELECT ' || columns || ' FROM one, (SELECT n, 1600000000000 + n::BIGINT * 20000 AS at
      FROM generate_series({first}, {last}) AS n) AS t';
END $$;
INSERT INTO job_labels SELECT tenant, 'day', CAST(created_at / 86400000 AS TEXT), id FROM jobs
  WHERE id > '{after}' AND archived = 1;
INSERT INTO job_labels SELECT tenant, 'rare', 'yes', id FROM jobs
  WHERE id > '{after}' AND archived = 1 AND right(id, 4) = '0001';
"""


def psql(text):
    done = subprocess.run(
        ["psql", "-q", "-v", "ON_ERROR_STOP=1", os.environ["MESHWAY_TEST_DATABASE"]],
        input=text, text=True, capture_output=True, check=False,
    )
    if done.returncode:
        sys.exit(done.stderr)
    return done.stdout


def main():
    jobs = int(os.environ.get("JOBS", "1000000"))
    with tempfile.TemporaryDirectory() as folder:
        service = Service(Path(folder))
        _, job = service.ask("POST", "/v1/jobs?preset=fast", sphere())
        job = json.loads(job)["id"]
        while json.loads(service.ask("GET", f"/v1/jobs/{job}")[1]).get("finished_at") is None:
            time.sleep(0.2)
        begun, step = time.time(), 500_000
        for first in range(1, jobs + 1, step):
            last = min(jobs, first + step - 1)
            at = 1_600_000_000_000 + (first - 1) * 20_000
            psql(FILL.format(first=first, last=last, after=f"job_{at:012x}7000{first - 1:016x}"))
        psql("""DELETE FROM totals;
                INSERT INTO totals SELECT tenant, status, COUNT(*) FROM jobs GROUP BY tenant, status;
                ANALYZE;""")
        size = psql("SELECT pg_size_pretty(pg_database_size(current_database()))").split("\n")[2].strip()
        print(f"{jobs:,} ended jobs, {size}, filled in {time.time() - begun:.0f} s\n")
        days = 1_600_000_000_000 // 86_400_000

        def name(n):
            return f"job_{1_600_000_000_000 + n * 20_000:012x}7000{n:016x}"

        def any_job():
            return name(random.randint(1, jobs))

        kinds = {
            "one job": lambda: f"/v1/jobs/{any_job()}",
            "newest page": lambda: "/v1/jobs?limit=50",
            "page anywhere": lambda: f"/v1/jobs?limit=50&cursor={any_job().encode().hex()}",
            "page of a state": lambda: "/v1/jobs?limit=50&status=cancelled",
            "page of a state that none has": lambda: "/v1/jobs?limit=50&status=running",
            "page of a common label": lambda: f"/v1/jobs?limit=50&label=day:{days + random.randint(0, jobs * 20 // 86_400)}",
            "page of a rare label": lambda: "/v1/jobs?limit=50&label=rare:yes",
            "page of a label that none has": lambda: "/v1/jobs?limit=50&label=rare:no",
            "page of a verdict": lambda: "/v1/jobs?limit=50&verdict=good",
            "events of a job": lambda: f"/v1/jobs/{any_job()}/events",
            "metrics": lambda: "/metrics",
        }
        print("| asked for | median | p99 | longest |\n|---|---|---|---|")
        for kind, path in kinds.items():
            took = sorted(service.ask("GET", path())[0] for _ in range(ASKED))
            print(f"| {kind} | {took[ASKED // 2]:.1f} | {took[ASKED * 99 // 100]:.1f} | {took[-1]:.1f} |")
        service.end()


main()
