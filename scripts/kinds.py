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


def slices(random):
    """Contours of an oblique ring: 5 times as far apart as their points are within one."""
    major, minor, apart = 10.0, 4.0, 1.0
    tilt = np.radians(35)
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 4000), np.linspace(0, 2 * np.pi, 2000))
    around = major + minor * np.cos(v)
    dense = np.stack([around * np.cos(u), around * np.sin(u), minor * np.sin(v)], -1).reshape(-1, 3) @ turn.T
    kept = []
    for z in np.arange(-12.5, 12.5, apart) + 0.137:
        near = dense[np.abs(dense[:, 2] - z) < 0.004]
        near[:, 2] = z
        random.shuffle(near)
        kept.append(thin(near, apart / 5))
    return np.concatenate(kept)


def thin(points, apart):
    """Points no two of which lie in one cell."""
    _, first = np.unique(np.floor(points / apart).astype(int), axis=0, return_index=True)
    return points[np.sort(first)]


def terrain(random):
    x, y = random.uniform(-10, 10, (2, 6000))
    bumps = random.uniform([-8, -8, -1.5, 2], [8, 8, 2.5, 4], (14, 4))
    z = sum(h * np.exp(-((x - a) ** 2 + (y - b) ** 2) / (2 * w * w)) for a, b, h, w in bumps)
    return np.stack([x, y, z], 1)


def tube(random):
    """A tube 160 times as long as it is thick, wound up."""
    length, radius, turns, winding = 320.0, 1.0, 4, 12.0
    t, a = random.uniform(0, 1, 6000), random.uniform(0, 2 * np.pi, 6000)
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


def hand(meshway, folder, *options):
    path = folder / "hand.xyz"
    run([meshway, "sample", "hand", "-n", "4000", "--seed", "5", *options, "-o", path])
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
    plain = hand(options.after, work)
    clouds = {
        "slices": (slices(random), [], (-50, 25)),
        "strays": (strays(plain[:, :3], random), [], (-60, 20)),
        "turned-normals": (turned(hand(options.after, work, "--normals"), random), [], (-60, 20)),
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
        write_ply(shown, points[distance < 6 * np.median(distance)])
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
             "--elevation", elevation, "--size", 360])


if __name__ == "__main__":
    main()
