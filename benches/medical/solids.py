"""Solids with known surfaces, in millimetres: f(p) is negative inside, zero on the surface.

Bodies of clinics in simple terms: balls and tubes of varying radius, joined smoothly, and pieces cut out of them. f is
close to the distance near the surface, where it is smooth; the judge projects along its gradient.
"""

import numpy as np


def ball(centre, radius):
    return lambda p: np.linalg.norm(p - np.asarray(centre, float), axis=-1) - radius


def ellipsoid(centre, radii):
    centre, radii = np.asarray(centre, float), np.asarray(radii, float)

    def f(p):
        q = (p - centre) / radii
        length = np.linalg.norm(q, axis=-1)
        slope = np.linalg.norm(q / radii, axis=-1)
        return length * (length - 1) / np.maximum(slope, 1e-12)

    return f


def tube(axis, radii):
    """All that is within a radius of a polyline; the radius changes evenly along each of its pieces."""
    axis = np.asarray(axis, float)
    radii = np.broadcast_to(np.asarray(radii, float), len(axis))

    def f(p):
        best = np.full(p.shape[:-1], np.inf)
        for a, b, from_, to in zip(axis, axis[1:], radii, radii[1:]):
            way = b - a
            share = np.clip((p - a) @ way / (way @ way), 0, 1)
            away = np.linalg.norm(p - a - share[..., None] * way, axis=-1)
            best = np.minimum(best, away - (from_ + (to - from_) * share))
        return best

    return f


def joined(width, *parts):
    """The union, rounded over `width`."""

    def f(p):
        first, *others = (part(p) for part in parts)
        for other in others:
            share = np.clip(0.5 + 0.5 * (other - first) / width, 0, 1)
            first = other * (1 - share) + first * share - width * share * (1 - share)
        return first

    return f


def without(width, whole, part):
    """What is left of `whole`, with rounded edges."""
    outside = joined(width, lambda p: -whole(p), part)
    return lambda p: -outside(p)


def organ():
    """A ball of radius 20 with two lobes."""
    return joined(4, ball((0, 0, 0), 20), ball((15, 6, 9), 9.5), ball((-11, -13, -8), 8.5)), ((-21, -23, -21), (26, 21, 21))


def vessel():
    """A bent tube of radius 5, oblique to the slices."""
    t = np.linspace(-1, 1, 81)
    axis = np.stack([25 * t, 14 * np.sin(1.6 * t), 18 * t + 7 * np.cos(2 * t)], 1)
    return tube(axis, 5), ((-31, -20, -27), (31, 20, 22))


def tree():
    """A vessel that branches three times, from radius 6 down to 2."""
    def bough(start, way, length, radius):
        t = np.linspace(0, 1, 13)[:, None]
        way = np.asarray(way, float) / np.linalg.norm(way)
        side = np.cross(way, (0.3, -0.8, 0.5))
        axis = np.asarray(start, float) + length * (t * way + 0.12 * np.sin(np.pi * t) * side)
        return axis, np.linspace(radius, 0.8 * radius, 13)

    trunk = bough((0, 0, -35), (0.15, 0.1, 1), 32, 6)
    left = bough(trunk[0][-1], (-0.8, 0.2, 0.8), 26, 4.5)
    right = bough(trunk[0][-1], (0.9, -0.1, 0.7), 28, 4.2)
    twigs = [
        bough(left[0][-1], (-0.9, -0.6, 0.6), 17, 3),
        bough(left[0][-1], (-0.1, 0.7, 1), 18, 2.6),
        bough(right[0][-1], (0.4, 0.8, 0.9), 18, 2.8),
        bough(right[0][-1], (1, -0.5, 0.3), 16, 2.5),
    ]
    return joined(2, *(tube(*bough) for bough in (trunk, left, right, *twigs))), ((-45, -24, -42), (50, 30, 42))


def aorta():
    """An arch with three vessels that leave it, radius 13 down to 9."""
    t = np.linspace(0, 1, 41)
    rising = np.stack([-32 * np.cos(np.pi * t), 10 * t, 32 * np.sin(np.pi * t) + 30], 1)
    falling = np.stack([np.full(20, 32.0) - 4 * np.linspace(0, 1, 20), np.linspace(10, 14, 20), np.linspace(30, -50, 20)], 1)
    start = np.stack([np.linspace(-26, -32, 10), np.zeros(10), np.linspace(0, 30, 10)], 1)
    axis = np.concatenate([start[:-1], rising, falling[1:]])
    radii = np.interp(np.linspace(0, 1, len(axis)), [0, 0.5, 1], [14, 12, 9])
    leaving = [
        tube([(-16, 3, 58), (-22, 1, 72), (-25, 0, 86)], [6, 5, 4.5]),
        tube([(0, 5, 62), (-2, 5, 74), (-3, 6, 86)], [4, 3.5, 3.5]),
        tube([(15, 7, 58), (20, 8, 72), (22, 9, 86)], [4.5, 4, 4]),
    ]
    return joined(3, tube(axis, radii), *leaving), ((-49, -16, -62), (47, 26, 92))


def vertebra():
    """A body with a canal behind it, two transverse and one spinous process."""
    body = without(2, ellipsoid((0, -12, 0), (22, 16, 15)), ball((0, 14, 0), 11))
    arch = tube([(-13, 0, 2), (-14, 10, 2), (-8, 20, 0), (0, 24, -2), (8, 20, 0), (14, 10, 2), (13, 0, 2)], 4.5)
    processes = [
        tube([(-13, 12, 2), (-26, 16, 4), (-35, 18, 6)], [5, 4, 3.5]),
        tube([(13, 12, 2), (26, 16, 4), (35, 18, 6)], [5, 4, 3.5]),
        tube([(0, 23, -2), (0, 36, -9), (0, 46, -13)], [5, 4, 4.5]),
    ]
    return joined(3, body, arch, *processes), ((-40, -29, -19), (40, 51, 17))


# name: (solid, whether constants may be chosen on it)
SOLIDS = {
    "organ": (organ, True),
    "vessel": (vessel, False),
    "tree": (tree, False),
    "aorta": (aorta, False),
    "vertebra": (vertebra, False),
}
