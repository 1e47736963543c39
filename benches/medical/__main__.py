"""Label maps of known solids, made into surfaces by meshway and by VTK, both held against the truth.

    python3 benches/medical [options] [-- ARGUMENTS OF meshway reconstruct]

The solids of solids.py, rasterised with thick, middle and equal voxel edges. Prints a Markdown table: lengths in mm,
angles in degrees, volume against that of the voxels. Seconds are those of the whole process for meshway, those of the
filters for VTK.
"""

import argparse
import datetime
import json
import os
import pathlib
import re
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
TARGET = HERE.parents[1] / "target"
OURS = "**meshway**"
SPACINGS = [(0.5, 0.5, 5), (0.7, 0.7, 3), (1, 1, 1)]
SOLIDS = ["organ", "vessel", "tree", "aorta", "vertebra"]


def output(*command):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"medical: {' '.join(map(str, command))}\n{done.stderr}")
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def ours(options, volume, stem):
    mesh, report = f"{stem}-meshway.ply", f"{stem}-meshway.json"
    command = [options.binary, "reconstruct", volume, "-q", "-o", mesh, "--report", report, *options.arguments]
    started = time.monotonic()
    output(*command)
    seconds = time.monotonic() - started
    return {"tool": OURS, "seconds": seconds, "mesh": mesh}


def measure(options, solid, spacing):
    stem = options.out / f"{solid}-{spacing[2]:g}"
    volume = f"{stem}.nii.gz"
    python = options.python
    [voxels] = output(python, HERE / "volumes.py", solid, *spacing, volume)
    rows = [ours(options, volume, stem), *output(python, HERE / "peers.py", volume, stem)]
    figures = output(python, HERE / "judge.py", solid, *(row["mesh"] for row in rows))
    for row, figure in zip(rows, figures):
        row |= figure | {"solid": solid, "spacing": spacing, "voxels": voxels}
        row["volume_percent"] = 100 * (row["volume"] / voxels["volume"] - 1)
    return rows


def table(rows):
    lines = [
        "| voxels (mm) | tool | mean | 95 % | largest | bias | normals | volume | pieces | seconds |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        name = f"{row['solid']} {' x '.join(f'{edge:g}' for edge in row['spacing'])}"
        lines.append(
            f"| {name} | {row['tool']} | {row['mean']:.3f} | {row['p95']:.3f} | {row['max']:.2f} | {row['bias']:+.3f} "
            f"| {row['normal']:.1f} | {row['volume_percent']:+.2f} % | {row['pieces']} | {row['seconds']:.1f} |"
        )
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(
        prog="medical", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    path = pathlib.Path
    parser.add_argument("--binary", type=path, default=TARGET / "release" / "meshway", help="meshway")
    parser.add_argument("--python", type=path, default=TARGET / "medical-venv" / "bin" / "python", help="with VTK")
    parser.add_argument("--out", type=path, default=TARGET / "medical", help="folder for all files")
    parser.add_argument("--only", default="", metavar="REGEX", help="cases by name, like `organ-5`")
    parser.add_argument("arguments", nargs="*", help="of meshway reconstruct")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for solid in SOLIDS:
        for spacing in SPACINGS:
            if re.search(options.only, f"{solid}-{spacing[2]:g}"):
                rows += measure(options, solid, spacing)
                (options.out / "figures.json").write_text(json.dumps(rows, indent=1) + "\n")
                print(table(rows[-4:]).splitlines()[2], file=sys.stderr, flush=True)
    if not rows:
        sys.exit(f"medical: no case matches {options.only!r}")
    print(f"{datetime.date.today()}, {len(os.sched_getaffinity(0))} cores\n\n{table(rows)}")


if __name__ == "__main__":
    main()
