"""How far meshes are from a solid's surface: judge.py SOLID MESH... prints a JSON object a line.

20,000 points drawn from the mesh, their distances to the surface, and the angles between the normals there.
"""

import json
import sys

import numpy as np
import solids
import trimesh

SAMPLES = 20_000
STEP = 1e-4
NEWTON = 8


def gradient(f, p):
    steps = STEP * np.eye(3)
    return np.stack([f(p + step) - f(p - step) for step in steps], -1) / (2 * STEP)


def measure(f, path):
    mesh = trimesh.load(path, process=False)
    points, triangles = trimesh.sample.sample_surface(mesh, SAMPLES, seed=1)
    foot = points.copy()
    for _ in range(NEWTON):
        slope = gradient(f, foot)
        foot -= (f(foot) / np.maximum((slope**2).sum(-1), 1e-9))[:, None] * slope
    normals = gradient(f, foot)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    signed = ((points - foot) * normals).sum(1)
    away = np.linalg.norm(points - foot, axis=1)
    facing = (mesh.face_normals[triangles] * normals).sum(1)
    # A mesh with its inside out is no worse for it.
    facing *= np.sign(mesh.volume)
    angles = np.degrees(np.arccos(np.clip(facing, -1, 1)))
    return {
        "mean": away.mean(),
        "p95": np.quantile(away, 0.95),
        "max": away.max(),
        "bias": signed.mean(),
        "normal": angles.mean(),
        "volume": abs(mesh.volume),
        "pieces": mesh.body_count,
    }


def main():
    name, *meshes = sys.argv[1:]
    solid, _ = solids.SOLIDS[name][0]()
    for path in meshes:
        print(json.dumps(measure(solid, path)))


if __name__ == "__main__":
    main()
