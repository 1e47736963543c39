"""Dense clouds from true surfaces, reconstructed by meshway and by Open3D's Poisson, both held against the truth.

    python3 benches/quality/dense [FOLDER] [options] [-- ARGUMENTS OF meshway reconstruct]

FOLDER holds true surfaces, closed meshes *.ply, *.obj or *.stl; the shapes of shapes.py join them in any case.
Prints Markdown tables, one for the shapes that constants may be chosen on and one for the others (halves.py):
geometric means by number of points and noise. Both tools get the points alone. Of the depths of Poisson the one with
the least Chamfer counts, cloud by cloud, though no user could choose it so. Chamfer and Hausdorff-95 in % of the
diagonal; what the other columns are: judge.py, poisson.py, processes.py. Tables and all figures (JSON, CSV) are
written to a folder as they come.
"""

import argparse
import datetime
import hashlib
import json
import os
import pathlib
import re
import subprocess
import sys

import halves
import names
import processes
import tables

HERE = pathlib.Path(__file__).resolve().parent
TARGET = HERE.parents[2] / "target"
ENDINGS = (".ply", ".obj", ".stl")

# Seconds for a step that only draws or judges.
PATIENCE = 600


def depths(points):
    """Noisy clouds want a coarse octree, dense ones a fine one."""
    return (8, 9) if points < 300_000 else (8, 9, 10)


class Bench:
    def __init__(self, options, arguments):
        self.options, self.arguments = options, arguments
        self.out, self.work = options.out, options.keep or options.out / "work"
        self.truth_folder = options.out / "truths"
        for folder in (self.out, self.work, self.truth_folder):
            folder.mkdir(parents=True, exist_ok=True)
        self.about = {
            "seed": options.seed,
            "arguments": arguments,
            "meshway": self.told([options.binary, "--version"]),
            "build": hashlib.sha256(options.binary.read_bytes()).hexdigest()[:12],
            "open3d": self.told(
                [options.python, "-c", "import importlib.metadata as m; print(m.version('open3d'))"]
            ),
            "cores": len(os.sched_getaffinity(0)),
        }
        self.rows = self.kept() if options.resume else []

    def told(self, command):
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    def kept(self):
        path = self.out / "figures.json"
        if not path.exists():
            return []
        before = json.loads(path.read_text())
        if before["about"] != self.about:
            sys.exit(f"dense: {path} is of another run: {before['about']}, not {self.about}")
        return before["rows"]

    def truths(self):
        """Name and file of each shape, those of the folder and those made here."""
        made = {name: self.truth_folder / f"{name}.ply" for name in halves.GENERATED}
        files = sorted(self.options.folder.iterdir()) if self.options.folder else []
        found = {path.stem: path for path in files if path.suffix.lower() in ENDINGS}
        if both := made.keys() & found.keys():
            sys.exit(f"dense: {self.options.folder} has shapes of names that are made here: {', '.join(sorted(both))}")
        if self.options.folder and not found:
            sys.exit(f"dense: {self.options.folder} has no true surfaces, {', '.join(ENDINGS)}")
        every = {name: path for name, path in (made | found).items() if self.options.half in (None, halves.half(name))}
        return dict(sorted(every.items(), key=lambda item: halves.order(item[0])))

    def make(self, name):
        """A generated shape, unless it is there and the program that makes it has not changed since."""
        path, maker = self.truth_folder / f"{name}.ply", HERE / "shapes.py"
        if not path.exists() or path.stat().st_mtime < maker.stat().st_mtime:
            self.step(maker, self.truth_folder, name)

    def step(self, program, *arguments):
        """What a program of this folder prints, a JSON value a line."""
        done = processes.run([self.options.python, HERE / program, *arguments], PATIENCE)
        if done.code != 0:
            sys.exit(f"dense: {pathlib.Path(program).name}: {done.errors}")
        return [json.loads(text) for text in done.output.splitlines()]

    def cloud(self, truth, shape, points, noise):
        name = names.cloud(shape, points, noise)
        if self.options.clouds and (given := self.options.clouds / f"{name}.ply").exists():
            return given
        path = self.work / f"{name}.ply"
        self.step("clouds.py", truth, path, "--points", points, "--noise", noise, "--seed", self.options.seed)
        return path

    def ours(self, cloud):
        mesh, report = (self.work / f"{cloud.stem}.meshway.{ending}" for ending in ("ply", "json"))
        command = [self.options.binary, "reconstruct", cloud, "-q", "-o", mesh, "--report", report]
        done = processes.run([*command, *self.arguments], self.options.limit)
        row = {"tool": tables.OURS, **done.costs()}
        if done.code != 0:
            return [(row | {"problem": done.problem()}, None)]
        told = json.loads(report.read_text())
        stages = {f"seconds_{stage}": seconds for stage, seconds in told["seconds"].items()}
        return [(row | {"verdict": told["verdict"]} | stages, mesh)]

    def peers(self, cloud, points):
        stem = self.work / f"{cloud.stem}.open3d"
        done = processes.run(
            [self.options.python, HERE / "poisson.py", cloud, stem, *depths(points)], self.options.limit
        )
        rows = [{"tool": tables.PEER, **json.loads(text)} for text in done.output.splitlines()]
        results = [(row, self.work / f"{stem.name}-{row['depth']}.ply") for row in rows]
        if done.code != 0:
            results.append(({"tool": tables.PEER, **done.costs(), "problem": done.problem()}, None))
        return results

    def measure(self, truth, shape, points, noise):
        """All that is asked of one cloud and not there yet."""
        name = names.cloud(shape, points, noise)
        known = {row["tool"] for row in self.rows if row["cloud"] == name}
        wanted = {tables.OURS} | ({tables.PEER} if self.options.peer else set())
        if not (wanted := wanted - known):
            return
        if shape in halves.GENERATED:
            self.make(shape)
        cloud = self.cloud(truth, shape, points, noise)
        results = self.ours(cloud) if tables.OURS in wanted else []
        results += self.peers(cloud, points) if tables.PEER in wanted else []
        judged, *figures = self.step("judge.py", truth, *(mesh for _, mesh in results if mesh))
        figures = iter(figures)
        about = {"cloud": name, "shape": shape, "half": halves.half(shape), "size": points, "noise": noise}
        for row, mesh in results:
            row = about | row
            if mesh:
                row |= next(figures)
                row["right_pieces"] = row.get("components") == judged["components"]
                row["right_genus"] = row.get("genus") is not None and row["genus"] == judged["genus"]
                if not tables.done(row):
                    row["problem"] = "a mesh without triangles"
            self.rows.append(row)
            print(tables.short(row), file=sys.stderr, flush=True)
        self.write()
        if not self.options.keep:
            for path in self.work.glob(f"{cloud.stem}.*"):
                path.unlink()

    def write(self):
        record = {"date": str(datetime.date.today()), "about": self.about, "rows": self.rows}
        (self.out / "figures.json").write_text(json.dumps(record, indent=1) + "\n")
        tables.write_csv(self.out / "figures.csv", self.rows)
        (self.out / "tables.md").write_text(self.tables())

    def tables(self):
        about = self.about
        title = f"{datetime.date.today()}, {about['cores']} cores, {about['meshway']}, build {about['build']}, "
        title += " ".join([f"Open3D {about['open3d']}, seed {about['seed']}", *about["arguments"]])
        parts = [title + "\n", *(tables.of_half(self.rows, half) for half in (halves.CHOSEN_ON, halves.SHOWN_ON))]
        parts += [tables.each(self.rows)] if self.options.each else []
        return "\n".join(part for part in parts if part)

    def run(self):
        truths = self.truths()
        for points in self.options.sizes:
            for noise in self.options.noises:
                for shape, truth in truths.items():
                    if re.search(self.options.only, names.cloud(shape, points, noise)):
                        self.measure(truth, shape, points, noise)
        if not self.rows:
            sys.exit(f"dense: no cloud matches {self.options.only!r}")
        self.write()
        print(self.tables())


def numbers(kind):
    """Reads `30000,100000`."""

    def read(text):
        return [kind(part) for part in text.split(",")]

    read.__name__ = f"list of {kind.__name__}"  # what argparse calls it in its errors
    return read


def main():
    parser = argparse.ArgumentParser(
        prog="dense", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    path = pathlib.Path
    parser.add_argument("folder", nargs="?", type=path, help="true surfaces; none: only those that are made here")
    parser.add_argument("--sizes", type=numbers(int), default=[30_000, 100_000, 500_000], metavar="N,...")
    parser.add_argument("--noises", type=numbers(float), default=[0.0, 0.1], metavar="PERCENT,...")
    parser.add_argument("--only", default="", help="clouds whose names (horse_30k_0.1) match this regular expression")
    parser.add_argument("--half", choices=[halves.CHOSEN_ON, halves.SHOWN_ON], help="only the shapes of this half")
    parser.add_argument("--peer", action=argparse.BooleanOptionalAction, default=True, help="whether Open3D runs")
    parser.add_argument("--each", action="store_true", help="besides, a table with a line a cloud")
    parser.add_argument("--seed", type=int, default=1, help="of the clouds")
    parser.add_argument("--clouds", type=path, help="clouds of this folder, where they have our names, are not drawn")
    parser.add_argument("--keep", type=path, help="keeps clouds, meshes and reports in this folder")
    parser.add_argument("--out", type=path, default=TARGET / "bench" / "dense", help="tables and figures")
    parser.add_argument("--resume", action="store_true", help="takes up what the figures of --out have")
    parser.add_argument("--limit", type=float, default=3600, help="seconds for one reconstruction")
    parser.add_argument("--binary", type=path, default=TARGET / "release" / "meshway")
    parser.add_argument("--python", type=path, default=TARGET / "quality-venv" / "bin" / "python3", help="has Open3D")
    split = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    options = parser.parse_args(sys.argv[1:split])
    for needed in filter(None, (options.folder, options.clouds, options.binary, options.python)):
        if not needed.exists():
            parser.error(f"{needed} is missing")
    Bench(options, sys.argv[split + 1 :]).run()


if __name__ == "__main__":
    main()
