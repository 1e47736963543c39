#!/usr/bin/env python3
"""The picture of docs/quality.md's dense clouds: dense.py MESHWAY FOLDER OUT.png

Draws a cloud from true surfaces of FOLDER, reconstructs it with one network (`network.block_points=0`: before there
were blocks) and with the default settings, and puts cloud and both meshes side by side, a row a shape. Needs numpy,
pillow and trimesh: the venv of `make bench-quality` has them.
"""
import argparse
import pathlib
import subprocess
import sys

from PIL import Image

SCRIPTS = pathlib.Path(__file__).parent
CLOUDS = SCRIPTS.parent / "benches" / "quality" / "dense" / "clouds.py"

# Azimuth and elevation from which a shape shows its face.
VIEWS = {"horse": (-60, 20), "igea": (0, 80)}


def run(*command):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"dense: {' '.join(map(str, command))}\n{done.stderr}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("meshway", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--shapes", default="horse,igea")
    parser.add_argument("--points", type=int, default=100_000)
    parser.add_argument("--noise", type=float, default=0.0)
    parser.add_argument("--size", type=int, default=360)
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path("target/dense-picture"))
    options = parser.parse_args()
    work = options.work
    work.mkdir(parents=True, exist_ok=True)
    rows = []
    for shape in options.shapes.split(","):
        cloud, picture = work / f"{shape}.ply", work / f"{shape}.png"
        run(sys.executable, CLOUDS, options.folder / f"{shape}.ply", cloud, "--points", options.points,
            "--noise", options.noise)
        files = [cloud]
        for label, settings in (("one", ["--set", "network.block_points=0"]), ("blocks", [])):
            files.append(work / f"{shape}-{label}.ply")
            run(options.meshway, "reconstruct", cloud, "-q", "-o", files[-1], *settings)
        azimuth, elevation = VIEWS.get(shape, (-60, 20))
        run(sys.executable, SCRIPTS / "render.py", picture, *files, f"--azimuth={azimuth}",
            f"--elevation={elevation}", "--size", options.size, "--tight", "--frame-of-first", "--point-radius", 0.5)
        rows.append(Image.open(picture))
    sheet = Image.new("RGB", (max(row.width for row in rows), sum(row.height for row in rows)), "white")
    for k, row in enumerate(rows):
        sheet.paste(row, (0, sum(above.height for above in rows[:k])))
    sheet.save(options.out, optimize=True)


if __name__ == "__main__":
    main()
