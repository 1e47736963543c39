#!/usr/bin/env python3
"""The pictures of docs/real.md: kinds.py BEFORE AFTER OUT_FOLDER

Makes a cloud of each kind that users bring (slices, strays, turned normals, terrain, a long tube), runs
two builds of Meshway on it with the default settings, and draws the cloud and the two meshes side by side.
Prints what each build says of its mesh. Needs numpy and pillow.
"""
import argparse
import json
import pathlib
import subprocess
import sys

import numpy as np

SCRIPTS = pathlib.Path(__file__).parent


def slices(dense):
    """Contours across a hand, on pixels: 6 times as far apart as the pixels are."""
    axis = int(np.argmax(np.ptp(dense, 0)))
    apart = np.ptp(dense, 0)[axis] / 45
    planes = np.round(dense[:, axis] / apart) * apart
    near = np.abs(dense[:, axis] - planes) < 0.02 * apart
    snapped = np.round(dense[near] / (apart / 6)) * (apart / 6)
    snapped[:, axis] = planes[near]
    return np.unique(snapped, axis=0)


def terrain(random):
    x, y = random.uniform(-10, 10, (2, 6000))
    bumps = random.uniform([-8, -8, -1.5, 2], [8, 8, 2.5, 4], (14, 4))
    z = sum(h * np.exp(-((x - a) ** 2 + (y - b) ** 2) / (2 * w * w)) for a, b, h, w in bumps)
    return np.stack([x, y, z], 1)


def tube(random):
    """A tube 200 times as long as it is thick, wound up."""
    length, radius, turns, winding = 200.0, 0.5, 3, 9.0
    t, a = random.uniform(0, 1, 8000), random.uniform(0, 2 * np.pi, 8000)
    pitch = np.sqrt((length / turns) ** 2 - (2 * np.pi * winding) ** 2) / (2 * np.pi)
    angle = 2 * np.pi * turns * t
    middle = np.stack([winding * np.cos(angle), winding * np.sin(angle), pitch * angle], 1)
    out = np.stack([np.cos(angle), np.sin(angle), 0 * t], 1)
    along = np.stack([-winding * np.sin(angle), winding * np.cos(angle), pitch + 0 * t], 1)
    along /= np.linalg.norm(along, axis=1)[:, None]
    across = np.cross(along, out)
    side = radius * (np.cos(a)[:, None] * out + np.sin(a)[:, None] * across)
    points = [middle + side]
    for end, sign in ((0.0, -1), (1.0, 1)):  # half balls
        cap = random.normal(size=(400, 3))
        cap *= radius / np.linalg.norm(cap, axis=1)[:, None]
        angle = 2 * np.pi * turns * end
        direction = np.array([-winding * np.sin(angle), winding * np.cos(angle), pitch])
        cap = cap[sign * (cap @ direction) > 0]
        points.append(cap[:40] + [winding * np.cos(angle), winding * np.sin(angle), pitch * angle])
    return np.concatenate(points)


def hand(meshway, folder, points, *options):
    path = folder / "hand.xyz"
    run([meshway, "sample", "hand", "-n", points, "--seed", "5", *options, "-o", path])
    return np.loadtxt(path, comments="#")


def strays(points, random):
    """4 % spread over the box and around it, and a few far away."""
    low, high = points.min(0), points.max(0)
    size = high - low
    wild = random.uniform(low - 0.2 * size, high + 0.2 * size, (len(points) // 25, 3))
    far = (low + high) / 2 + random.normal(size=(3, 3)) * 6 * size.max()
    return np.concatenate([points, wild, far])


def turned(points, random):
    """30 % of the normals inside out."""
    points = points.copy()
    points[random.random(len(points)) < 0.3, 3:] *= -1
    return points


def run(command):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"kinds: {' '.join(map(str, command))}\n{done.stderr}")


def write_ply(path, points):
    head = "ply\nformat binary_little_endian 1.0\nelement vertex %d\n%send_header\n" % (
        len(points), "".join(f"property double {axis}\n" for axis in "xyz"))
    path.write_bytes(head.encode() + points[:, :3].astype("<f8").tobytes())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("before")
    parser.add_argument("after")
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path("target/kinds"))
    parser.add_argument("--only")
    options = parser.parse_args()
    work = options.work
    work.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(20)
    plain = hand(options.after, work, 4000)
    clouds = {
        "slices": (slices(hand(options.after, work, 400_000)), [], (-60, 60)),
        "strays": (strays(plain[:, :3], random), [], (-60, 60)),
        "turned-normals": (turned(hand(options.after, work, 4000, "--normals"), random), [], (-60, 60)),
        "terrain": (terrain(random), ["--set", "surface.open=trimmed"], (-50, 35)),
        "tube": (tube(random), [], (-50, 25)),
    }
    for name, (points, settings, (azimuth, elevation)) in clouds.items():
        if options.only not in (None, name):
            continue
        table, shown = work / f"{name}.xyz", work / f"{name}.ply"
        np.savetxt(table, points, fmt="%.9g")
        # The far points would make the picture of the others small.
        middle = np.median(points[:, :3], 0)
        distance = np.linalg.norm(points[:, :3] - middle, axis=1)
        seen = points[distance < 6 * np.median(distance)]
        if name == "tube":  # too thin to be seen as a whole
            seen = seen[seen[:, 2] < np.quantile(seen[:, 2], 0.06)]
        write_ply(shown, seen)
        pictures = [shown]
        for label, build in (("before", options.before), ("after", options.after)):
            mesh, report = work / f"{name}-{label}.ply", work / f"{name}-{label}.json"
            extra = settings if label == "after" else []
            run([build, "reconstruct", table, "-o", mesh, "--report", report, "--quiet", *extra])
            told = json.loads(report.read_text())
            print(name, label, json.dumps({
                "verdict": told.get("verdict"),
                **{key: told["mesh"].get(key) for key in ("components", "genus", "volume")},
                "warnings": [w["code"] for w in told["warnings"]],
            }))
            pictures.append(mesh)
        run([sys.executable, SCRIPTS / "render.py", options.out / f"{name}.png", *pictures, "--azimuth", azimuth,
             "--elevation", elevation, "--size", 360, "--frame-of-first"])


if __name__ == "__main__":
    main()
