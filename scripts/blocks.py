#!/usr/bin/env python3
"""A large cloud on one worker and on several: `make bench-blocks POINTS=5000000 WORKERS=2`.

Workers are machines of their own, with THREADS threads each, beside one service. With CORE=0.5 each gets that much of a
core, one alone as well as each of several (as root, by control groups): so four can be measured on two cores. The cloud
is a ball with bumps that one network cannot follow, or the file CLOUD. Prints a table of seconds, by stage; the meshes
must be the same, byte for byte. With ALONE=no, only the several are measured.
"""

import hashlib
import json
import math
import os
import random
import struct
import sys
import tempfile
import time
from pathlib import Path

from bench_service import Process, Service

STAGES = ["sampling", "training", "surface", "report", "total"]
HELPED = "blocks of another worker's job were fitted"


def cloud(count):
    """A PLY file of points at random places, without normals."""
    random.seed(1)
    head = (f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n"
            "property float x\nproperty float y\nproperty float z\nend_header\n")
    points = bytearray(head.encode())
    for _ in range(count):
        x, y, z = random.gauss(0, 1), random.gauss(0, 1), random.gauss(0, 1)
        length = math.sqrt(x * x + y * y + z * z)
        x, y, z = x / length, y / length, z / length
        radius = 1 + 0.01 * math.sin(40 * x) * math.sin(40 * y) * math.cos(40 * z)
        points += struct.pack("<3f", radius * x, radius * y, radius * z)
    return bytes(points)


def confine(process, name, core):
    """Gives a process, and those that it starts, so much of a core."""
    groups = Path("/sys/fs/cgroup")
    old = groups / "cpu"
    group = (old if old.is_dir() else groups) / f"meshway-{name}"
    group.mkdir(exist_ok=True)
    period, quota = 100_000, int(100_000 * core)
    if old.is_dir():
        (group / "cpu.cfs_period_us").write_text(str(period))
        (group / "cpu.cfs_quota_us").write_text(str(quota))
    else:
        (groups / "cgroup.subtree_control").write_text("+cpu")
        (group / "cpu.max").write_text(f"{quota} {period}")
    (group / "cgroup.procs").write_text(str(process.pid))


def with_children(process):
    """A process, and those that it and its children started."""
    of_tasks = (f"/proc/{process}/task/{task}/children" for task in os.listdir(f"/proc/{process}/task"))
    children = [int(child) for file in of_tasks for child in Path(file).read_text().split()]
    return [process, *(pid for child in children for pid in with_children(child))]


def peak(process):
    """The most memory that a process has had, in GB."""
    status = Path(f"/proc/{process}/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 1e6


def worked(process):
    """Seconds that a process has had a core, with its children that have ended."""
    after_name = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    return sum(map(int, after_name[11:15])) / os.sysconf("SC_CLK_TCK")


def run(folder, data, count, threads):
    """Seconds by stage with so many workers; what else is told of them; and the hash of the mesh."""
    objects = os.environ["MESHWAY_TEST_OBJECTS"].replace("s3://tests", f"s3://tests/{count}-workers", 1)
    objects = f"--objects={objects}"
    service = Service(folder / "service", objects, "--workers=0")
    flags = [objects, "--slots=1", f"--threads-per-worker={threads}"]
    workers = [Process(folder / f"worker-{k}", "worker", *flags) for k in range(count)]
    if "CORE" in os.environ:
        for k, worker in enumerate(workers):
            confine(worker.process, k, float(os.environ["CORE"]))
    time.sleep(3)
    _, job = service.ask("POST", "/v1/jobs", data)
    path = f"/v1/jobs/{json.loads(job)['id']}"
    while json.loads(service.ask("GET", path)[1]).get("finished_at") is None:
        time.sleep(0.5)
    job = json.loads(service.ask("GET", path)[1])
    if job["status"] != "succeeded":
        sys.exit(json.dumps(job, indent=1))
    report = json.loads(service.ask("GET", f"{path}/report")[1])
    mesh = hashlib.sha256(service.ask("GET", f"{path}/mesh")[1]).hexdigest()
    pids = [pid for worker in workers for pid in with_children(worker.process.pid)]
    memory, work = max(map(peak, pids)), sum(map(worked, pids))
    for process in [*workers, service]:
        process.end()
    helped = sum(worker.log.read_text().count(HELPED) for worker in workers)
    blocks = (report.get("blocks") or {}).get("count", 0)
    return report["seconds"], [f"{work:.0f}", f"{memory:.2f} GB", blocks, helped], mesh


def main():
    points = int(os.environ.get("POINTS", "1000000"))
    many, threads = int(os.environ.get("WORKERS", "2")), os.environ.get("THREADS", "1")
    data = Path(os.environ["CLOUD"]).read_bytes() if "CLOUD" in os.environ else cloud(points)
    of_a_core = f", {os.environ['CORE']} of a core each" if "CORE" in os.environ else ""
    print(f"{os.environ.get('CLOUD', f'{points:,} points')}, {threads} thread(s) a worker{of_a_core}\n")
    columns = ["workers", *STAGES, "seconds of cores", "most memory of one", "blocks", "shares of helpers"]
    print(f"| {' | '.join(columns)} |\n" + "|---" * len(columns) + "|")
    totals, meshes = [], set()
    server = os.environ["MESHWAY_TEST_DATABASE"]
    counts = [many] if os.environ.get("ALONE") == "no" else [1, many]
    for count in counts:
        # A database each: an object store belongs to one.
        name = f"blocks_{count}"
        os.system(f"psql -q '{server}' -c 'CREATE DATABASE {name}'")
        os.environ["MESHWAY_TEST_DATABASE"] = server.rsplit("/", 1)[0] + f"/{name}"
        with tempfile.TemporaryDirectory() as folder:
            seconds, others, mesh = run(Path(folder), data, count, threads)
        cells = " | ".join([*(f"{seconds[stage]:.1f}" for stage in STAGES), *map(str, others)])
        print(f"| {count} | {cells} |", flush=True)
        totals.append(seconds["total"])
        meshes.add(mesh)
    if len(counts) == 1:
        return
    print(f"\n{many} workers take {totals[1] / totals[0]:.2f} of the time of one")
    if len(meshes) != 1:
        sys.exit("the meshes are not the same")
    print("the meshes are the same")


main()
