#!/usr/bin/env python3
"""Draws a bare cloud from a true surface: clouds.py TRUTH CLOUD.ply --points N [--noise PERCENT] [--seed SEED]

Points are uniform over the area; noise is normal along each axis, its standard deviation in % of the diagonal.
Needs numpy and trimesh.
"""

import argparse
import pathlib
import zlib

import numpy as np
import trimesh

import ply


def draw(corners, count, noise, random):
    """Points on triangles given by their corners [n, 3, 3]; noise in units of length."""
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    a, b, c = corners[random.choice(len(corners), count, p=area / area.sum())].transpose(1, 0, 2)
    # The square root: half of the area of a triangle lies in the outer 30 % of the way from a to the other side.
    outwards, along = np.sqrt(random.random((count, 1))), random.random((count, 1))
    points = a + outwards * ((1 - along) * (b - a) + along * (c - a))
    return points + noise * random.normal(size=points.shape)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("truth", type=pathlib.Path)
    parser.add_argument("cloud", type=pathlib.Path)
    parser.add_argument("--points", type=int, required=True)
    parser.add_argument("--noise", type=float, default=0.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    mesh = trimesh.load(options.truth, force="mesh", process=False)
    diagonal = np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    # Each cloud has draws of its own, so that one alone is the same as one among others.
    random = np.random.default_rng([options.seed, zlib.crc32(options.cloud.stem.encode())])
    points = draw(np.asarray(mesh.triangles, float), options.points, 0.01 * options.noise * diagonal, random)
    ply.write(options.cloud, points)


if __name__ == "__main__":
    main()
