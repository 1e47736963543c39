#!/usr/bin/env python3
"""An upgrade while jobs run: `make upgrade OLD=PROGRAM`, with the program of an earlier version.

The old program serves and works over one database and one object store. Jobs are submitted all the time. The new one
brings the tables up to date, then serves and works beside the old one, then alone. Every job must succeed, at its
first attempt or the one after it was given back, and each service must show all of them.
"""

import json
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench_service import PROGRAM, Process, Service, sphere

SECONDS = 10
SETTINGS = {"training": {"max_evaluations": 200}, "surface": {"resolution": 32}}


class Upgrade:
    def __init__(self, folder, old):
        self.folder, self.old, self.jobs, self.asked = folder, old, [], 0
        self.objects = f"--objects={os.environ['MESHWAY_TEST_OBJECTS']}"

    def serve(self, name, program):
        return Service(self.folder / name, self.objects, "--workers=0", program=program)

    def work(self, name, program):
        flags = [self.objects, "--slots=1", "--threads-per-worker=1"]
        return Process(self.folder / name, "worker", *flags, program=program)

    def submit(self, services, what):
        """Submits to the services in turn for a while."""
        end, before = time.time() + SECONDS, len(self.jobs)
        while time.time() < end:
            service = services[self.asked % len(services)]
            self.asked += 1
            body = json.dumps({"cloud_id": self.cloud, "preset": "fast", "settings": SETTINGS})
            self.jobs.append(json.loads(service.ask("POST", "/v1/jobs", body)[1])["id"])
            # Each shows the jobs of the other.
            shown = services[self.asked % len(services)]
            shown.ask("GET", f"/v1/jobs/{random.choice(self.jobs)}")
            shown.ask("GET", "/v1/jobs?limit=20")
            time.sleep(0.5)
        print(f"{what}: {len(self.jobs) - before} jobs", flush=True)

    def run(self):
        old_service, old_worker = self.serve("old-service", self.old), self.work("old-worker", self.old)
        self.cloud = json.loads(old_service.ask("POST", "/v1/clouds", sphere())[1])["id"]
        self.submit([old_service], "the old one alone")
        database = f"--database={os.environ['MESHWAY_TEST_DATABASE']}"
        migrated = subprocess.run([PROGRAM, "migrate", database], capture_output=True, text=True, check=False)
        print((migrated.stdout or migrated.stderr).strip())
        if migrated.returncode:
            sys.exit("the tables were not brought up to date")
        self.submit([old_service], "the old one with new tables")
        service, worker = self.serve("service", PROGRAM), self.work("worker", PROGRAM)
        self.submit([old_service, service], "both")
        old_service.end()
        old_worker.end()
        self.submit([service], "the new one alone")
        attempts = []
        for job in self.jobs:
            while (told := json.loads(service.ask("GET", f"/v1/jobs/{job}")[1])).get("finished_at") is None:
                time.sleep(0.2)
            if told["status"] != "succeeded" or told["failures"]:
                sys.exit(json.dumps(told, indent=1))
            service.ask("GET", f"/v1/jobs/{job}/mesh")
            attempts.append(told["attempt"])
        service.end()
        worker.end()
        again = sum(attempt > 1 for attempt in attempts)
        print(f"{len(self.jobs)} of {len(self.jobs)} jobs succeeded, {again} of them given back once by the old worker")
        if max(attempts) > 2:
            sys.exit(f"attempts: {attempts}")


def main():
    old = os.environ.get("OLD") or sys.exit("OLD=PROGRAM is missing: the program of an earlier version")
    with tempfile.TemporaryDirectory() as folder:
        Upgrade(Path(folder), old).run()


main()
