#!/usr/bin/env python3
"""True surfaces with long parts, folds, sharp edges and parts that nearly touch: shapes.py FOLDER NAME...

Writes FOLDER/NAME.ply: closed, manifold, free of self-intersections, its box around the origin with a diagonal of
100. The same on every call. Needs numpy, trimesh, scikit-image
and manifold3d.
"""

import math
import pathlib
import sys

import numpy as np

import ply

DIAGONAL = 100.0


def bone(around=360, along=900):
    """A bent shaft between a head with two condyles and a round one beside its neck: 25 times as long as thick.

    A surface of revolution, flattened and moved sideways by functions of the height alone, which cannot make it
    meet itself.
    """
    u = np.linspace(-np.pi / 2, np.pi / 2, along + 1)
    z = np.sin(u)

    def bump(at, width):
        return np.exp(-(((z - at) / width) ** 2))

    radius = 0.036 + 0.010 * z**2 + 0.062 * bump(-0.93, 0.10) + 0.055 * bump(0.93, 0.075) - 0.012 * bump(0.78, 0.05)
    radius *= np.sqrt(np.maximum(1 - z**24, 0))
    vertices, triangles = revolution(z, radius, around)
    x, y, z = vertices.T
    # Two condyles: the lower end is wider than deep, and has a groove across.
    low = 1 / (1 + np.exp((z + 0.82) / 0.03))
    x = x * (1 + 0.55 * low)
    z = z + 0.05 * low * np.exp(-((x / 0.035) ** 2)) * np.clip(-z - 0.6, 0, 1)
    # A bow, and the neck that carries the upper head aside.
    x = x + 0.05 * np.cos(1.3 * z) + 0.11 / (1 + np.exp(-(z - 0.80) / 0.035))
    y = y + 0.03 * np.sin(2.2 * z)
    return np.stack([x, y, z], 1), triangles


def capsule(around=128):
    """200 times as long as it is thick."""
    radius, half = 0.5, 99.5
    u = np.linspace(0, np.pi / 2, 33)
    shaft = np.linspace(-half, half, 801)[1:-1]
    z = np.concatenate([-half - radius * np.cos(u), shaft, half + radius * np.sin(u)])
    r = np.concatenate([radius * np.sin(u), np.full(len(shaft), radius), radius * np.cos(u)])
    vertices, triangles = revolution(z, r, around)
    return vertices @ rotation(1).T, triangles


def brain(seed=3, subdivisions=8):
    """An egg with grooves 2 % of the diagonal wide and 10 % deep, and a cleft that halves it.

    The grooves run along the zeros of a function of narrow band, so that they wind and branch; their depth depends
    on the direction from the centre alone, so that the surface cannot meet itself, and a twist undercuts them.
    """
    from trimesh.creation import icosphere

    ball = icosphere(subdivisions)
    unit = np.asarray(ball.vertices, float)
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    random = np.random.default_rng(seed)
    waves = random.normal(size=(24, 3))
    waves *= random.uniform(8, 9, (24, 1)) / np.linalg.norm(waves, axis=1)[:, None]
    angles = unit @ waves.T + random.uniform(0, 2 * np.pi, 24)
    slope = -(np.sin(angles) @ waves)
    slope -= unit * np.einsum("ij,ij->i", slope, unit)[:, None]
    across = np.cos(angles).sum(1) / np.maximum(np.linalg.norm(slope, axis=1), 8.0)
    groove = 0.32 * np.exp(-((across / 0.05) ** 2))
    cleft = 0.42 * np.exp(-((unit[:, 0] / 0.05) ** 2)) / (1 + np.exp(-(unit[:, 2] + 0.2) / 0.1))
    x, y, z = (unit * (1 - smooth_maximum(groove, cleft, 0.05))[:, None]).T
    turn = 0.35 * z
    x, y = np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y
    return np.stack([0.85 * x, 1.1 * y, 0.8 * z], 1), np.asarray(ball.faces, int)


def meander(along=1000, across=280):
    """A thin sheet in overhanging folds, as a curtain has them: 46 times as long as thick."""
    folds, steepest, thickness, width = 3, 1.85, 0.13, 1.6
    s = np.sin(np.linspace(-np.pi / 2, np.pi / 2, along + 1))
    t = np.sin(np.linspace(-np.pi / 2, np.pi / 2, across + 1))
    half = 0.5 * thickness * np.sqrt(np.maximum(1 - s**40, 0))[:, None] * np.sqrt(np.maximum(1 - t**24, 0))
    # The middle line: its direction swings by `steepest` to both sides, once a fold.
    fine = np.linspace(-1, 1, 40_001)
    swing = steepest * np.sin(np.pi * folds * fine)
    step = np.stack([np.cos(swing), np.sin(swing)], 1) * folds * (fine[1] - fine[0])
    line = np.cumsum(step, 0)
    line -= line.mean(0)
    middle = np.stack([np.interp(s, fine, line[:, k]) for k in (0, 1)], 1)
    swing = np.interp(s, fine, swing)
    normal = np.stack([-np.sin(swing), np.cos(swing)], 1)
    sides = []
    for sign in (1, -1):
        xz = middle[:, None, :] + sign * half[:, :, None] * normal[:, None, :]
        y = np.broadcast_to(0.5 * width * t, half.shape)
        # Both bends are functions of y alone.
        x, z = xz[..., 0] + 0.06 * np.sin(3 * y), xz[..., 1] + 0.10 * np.cos(2.5 * y)
        sides.append(np.stack([x, y, z], -1).reshape(-1, 3))
    index = np.arange((along + 1) * (across + 1)).reshape(along + 1, across + 1)
    top = grid_triangles(index)
    rim = np.zeros(index.shape, bool)
    rim[[0, -1], :] = rim[:, [0, -1]] = True
    top = top[~rim.ravel()[top].all(1)]  # at two corners, where both sides would have the same one
    under = np.where(rim.ravel(), index.ravel(), index.ravel() + index.size)[top]  # the rim is of both sides
    return used(np.concatenate(sides), np.concatenate([top, under[:, ::-1]]))


def bracket():
    """Two plates at a right angle with a rib, holes, a counterbore and a slot."""
    solid = manifold()
    block, hole = solid.cube, lambda height, radius: solid.cylinder(height, radius, radius, 256, True)
    body = block((70, 44, 7)) + block((7, 44, 48))
    rib = solid.extrude(section([(0, 0), (38, 0), (0, 34)]), 6).rotate((90, 0, 0)).translate((6, 25, 6))
    body = body + rib
    for y in (9, 35):
        body = body - hole(40, 3.2).translate((56, y, 0)) - hole(6, 6).translate((56, y, 7))
    body = body - hole(40, 8).rotate((0, 90, 0)).translate((0, 22, 34))
    slot = block((24, 6, 40), True) + hole(40, 3).translate((-12, 0, 0)) + hole(40, 3).translate((12, 0, 0))
    return mesh_of(body - slot.translate((30, 9, 0)), 2)


def gear(teeth=18):
    """A spur gear with a hub, a bore with a keyway and six holes."""
    solid = manifold()
    pitch = 2 * np.pi / teeth
    outline = [
        (radius * math.cos(k * pitch + share * pitch), radius * math.sin(k * pitch + share * pitch))
        for k in range(teeth)
        for share, radius in ((-0.30, 20.0), (-0.13, 24.5), (0.13, 24.5), (0.30, 20.0))
    ]
    wheel = solid.extrude(section(outline), 9).translate((0, 0, -4.5))
    rod = lambda height, radius: solid.cylinder(height, radius, radius, 256, True)
    wheel = wheel + rod(20, 8).translate((0, 0, 5)) - rod(60, 4.5) - solid.cube((3, 3, 60), True).translate((5, 0, 0))
    for k in range(6):
        wheel = wheel - rod(40, 2.6).translate((13.5 * math.cos(k * np.pi / 3), 13.5 * math.sin(k * np.pi / 3), 0))
    return mesh_of(wheel, 3)


# Limbs of the figure: places and radii along them.
TORSO = [((0, 0, 10), 7.0), ((0, 0, 22), 6.2), ((0, 0, 34), 8.0)]
LIMBS = [
    [((0, 0, 36), 3.4), ((0, -1, 46), 5.4)],  # head
    [((-3, 0, 49), 1.8), ((-7, 0, 55), 1.3), ((-7, -3, 62), 0.7)],  # horns
    [((3, 0, 49), 1.8), ((7, 0, 55), 1.3), ((7, -3, 62), 0.7)],
    [((-7, 0, 37), 3.0), ((-17, 3, 27), 2.3), ((-9.6, 0, 14), 1.9)],  # a hand on the hip
    [((7, 0, 37), 3.0), ((15, -6, 46), 2.3), ((6.5, -5.1, 47.5), 1.7)],  # one at the ear
    [((-3.6, 0, 9), 4.2), ((-3.2, -2, -10), 2.7), ((-4, 0, -30), 1.9), ((-4, -6, -31), 1.6)],  # legs, knee to knee
    [((3.6, 0, 9), 4.2), ((3.2, -2, -10), 2.7), ((4, 0, -30), 1.9), ((4, -6, -31), 1.6)],
    [((0, 6, 10), 2.2), ((0, 14, -4), 1.6), ((5, 10, -16), 1.3), ((7.1, 0.8, -19.5), 0.9)],  # tail around a leg
]


def figure(cells=400):
    """A body with limbs that come within 1 % of the diagonal of it and of each other: knees, hands, tail."""

    def chain(p, places):
        distance = np.full(len(p), np.inf)
        for (a, ra), (b, rb) in zip(places, places[1:]):
            a, axis = np.array(a, float), np.subtract(b, a).astype(float)
            t = np.clip((p - a) @ axis / (axis @ axis), 0, 1)
            piece = np.linalg.norm(p - a - t[:, None] * axis, axis=1) - (ra + t * (rb - ra))
            distance = piece if np.isinf(distance[0]) else -smooth_maximum(-distance, -piece, 1.0)
        return distance

    def field(p):
        distance = chain(p, TORSO)
        for limb in LIMBS:
            # Flows into the body where it begins, and nowhere else.
            root = np.linalg.norm(p - np.array(limb[0][0], float), axis=1)
            distance = -smooth_maximum(-distance, -chain(p, limb), 0.05 + 3.0 * np.exp(-((root / 7) ** 2)))
        return distance

    return zero_surface(field, [-21, -11, -34], [19, 18, 64], cells)


def knot(around=96, along=3200):
    """A tube along a torus knot, its strands 1.6 % of the diagonal apart where they are next to each other; of genus 1."""
    p, q, radius = 3, 8, 0.34
    t = np.linspace(0, 2 * np.pi, along, endpoint=False)

    def curve(t):
        ring = 2 + 0.8 * np.cos(q * t)
        return np.stack([ring * np.cos(p * t), ring * np.sin(p * t), 0.8 * np.sin(q * t)], 1)

    centre = curve(t)
    tangent = curve(t + 1e-5) - curve(t - 1e-5)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    # Across the strand, away from the middle of the torus' tube: smooth and periodic.
    ring = np.stack([2 * np.cos(p * t), 2 * np.sin(p * t), 0 * t], 1)
    outward = centre - ring
    outward -= tangent * np.einsum("ij,ij->i", outward, tangent)[:, None]
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    beside = np.cross(tangent, outward)
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    circle = np.cos(angle)[None, :, None] * outward[:, None] + np.sin(angle)[None, :, None] * beside[:, None]
    vertices = (centre[:, None] + radius * circle).reshape(-1, 3)
    index = np.arange(along * around).reshape(along, around)
    index = np.concatenate([index, index[:1]])
    return vertices, grid_triangles(np.concatenate([index, index[:, :1]], 1))[:, ::-1]


def revolution(z, radius, around):
    """A surface around the z axis; the radius is 0 at both ends."""
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    inner = slice(1, -1)
    rings = np.stack([
        np.outer(radius[inner], np.cos(angle)), np.outer(radius[inner], np.sin(angle)),
        np.broadcast_to(z[inner, None], (len(z) - 2, around)),
    ], -1)
    vertices = np.concatenate([rings.reshape(-1, 3), [[0, 0, z[0]], [0, 0, z[-1]]]])
    index = np.arange((len(z) - 2) * around).reshape(-1, around)
    index = np.concatenate([index, index[:, :1]], 1)
    first, last = len(vertices) - 2, len(vertices) - 1
    caps = [(first, b, a) for a, b in zip(index[0], index[0][1:])]
    caps += [(last, a, b) for a, b in zip(index[-1], index[-1][1:])]
    return vertices, np.concatenate([grid_triangles(index)[:, ::-1], np.array(caps)])


def grid_triangles(index):
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    return np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)


def smooth_maximum(a, b, width):
    """The larger one; rounded where they differ by less than `width`."""
    overlap = np.maximum(width - np.abs(a - b), 0) / width
    return np.maximum(a, b) + 0.25 * width * overlap**2


def zero_surface(field, low, high, cells, steepest=1.5, block=8):
    """Where `field` is zero in the box, by marching cubes; its vertices moved onto it.

    Blocks of cells are left out where the field at their centre is too large for it to be zero in them, being
    nowhere steeper than `steepest`.
    """
    from skimage.measure import marching_cubes

    low, high = np.array(low, float), np.array(high, float)
    step = (high - low).max() / cells
    counts = np.ceil((high - low) / step / block).astype(int)
    centres = (np.indices(counts).reshape(3, -1).T + 0.5) * block * step + low - 0.5 * step
    coarse = in_parts(field, centres).reshape(counts)
    near = np.abs(coarse) < steepest * 0.5 * np.sqrt(3) * (block + 1) * step
    values, near = (np.kron(grid, np.ones((block,) * 3, grid.dtype)) for grid in (coarse.astype(np.float32), near))
    places = np.argwhere(near)
    values[near] = in_parts(field, places * step + low)
    vertices, triangles, _, _ = marching_cubes(values, 0.0, spacing=(step,) * 3, allow_degenerate=False)
    vertices = vertices.astype(float) + low
    for _ in range(2):
        sides = [in_parts(field, vertices + sign * 0.01 * step * axis) for axis in np.eye(3) for sign in (1, -1)]
        slope = np.stack([right - left for right, left in zip(sides[::2], sides[1::2])], 1) / (0.02 * step)
        steep = np.maximum((slope**2).sum(1), 1e-6)
        move = -in_parts(field, vertices) / steep
        move *= np.minimum(1, 0.2 * step / np.maximum(np.abs(move) * np.sqrt(steep), 1e-12))
        vertices += slope * move[:, None]
    return vertices, triangles


def in_parts(field, points, size=200_000):
    """Of many points, few at a time: they fit the caches."""
    return np.concatenate([field(points[k : k + size]) for k in range(0, len(points), size)])


def manifold():
    from manifold3d import Manifold

    return Manifold


def section(outline):
    from manifold3d import CrossSection

    return CrossSection([np.array(outline, float)])


def mesh_of(solid, seed):
    """Vertices and triangles, turned so that no face lies along an axis."""
    mesh = solid.to_mesh()
    return np.asarray(mesh.vert_properties, float)[:, :3] @ rotation(seed).T, np.asarray(mesh.tri_verts, int)


def rotation(seed):
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.linalg.det(q)


def used(vertices, triangles):
    kept, triangles = np.unique(triangles, return_inverse=True)
    return vertices[kept], triangles.reshape(-1, 3)


def framed(vertices):
    low, high = vertices.min(0), vertices.max(0)
    return (vertices - (low + high) / 2) * (DIAGONAL / np.linalg.norm(high - low))


SHAPES = {maker.__name__: maker for maker in (bone, capsule, brain, meander, bracket, gear, figure, knot)}


def main():
    folder, *names = sys.argv[1:]
    for name in names:
        vertices, triangles = SHAPES[name]()
        ply.write(pathlib.Path(folder) / f"{name}.ply", framed(vertices), triangles)


if __name__ == "__main__":
    main()
