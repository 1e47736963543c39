#!/usr/bin/env python3
"""Renders PLY clouds and meshes side by side into one PNG: render.py OUT.png FILE.ply [FILE.ply ...]

A z-buffer in numpy, lit from the viewer's upper left; points are drawn as small discs. Needs numpy
and pillow. Made for the pictures of the documentation and for a quick look at a result.
"""
import argparse
import numpy as np
from PIL import Image

TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
         "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int32": "i4", "uint32": "u4",
         "float32": "f4", "float64": "f8"}


def read_ply(path):
    """Vertices and triangles of a binary little-endian PLY, as Meshway writes it."""
    data = open(path, "rb").read()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    vertices, triangles, element, elements = None, np.zeros((0, 3), int), None, []
    for line in data[:end].decode("latin-1").splitlines():
        words = line.split()
        if words[:1] == ["element"]:
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            elements[-1][2].append(words[1:])
    at = end
    for name, count, properties in elements:
        if properties[0][0] == "list":
            size, index = (np.dtype(TYPES[t]) for t in properties[0][1:3])
            row = np.dtype([("n", size), ("v", index, 3)])
        else:
            row = np.dtype([(p[1], "<" + TYPES[p[0]]) for p in properties])
        rows = np.frombuffer(data, row, count, at)
        at += count * row.itemsize
        if name == "vertex":
            keep = rows["label"] == 0 if "label" in row.names else slice(None)
            vertices = np.stack([rows[c][keep].astype(float) for c in "xyz"], 1)
        elif name == "face":
            triangles = rows["v"].astype(int)
    return vertices, triangles


def camera(azimuth, elevation):
    a, e = np.radians([azimuth, elevation])
    turn = np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]])
    tilt = np.array([[1, 0, 0], [0, np.sin(e), np.cos(e)], [0, -np.cos(e), np.sin(e)]])
    return tilt @ turn  # rows: right, up, towards the viewer


def draw(vertices, triangles, view, centre, scale, size, point_radius):
    image = np.full((size, size, 3), 255.0)
    depth = np.full((size, size), -np.inf)
    p = (vertices - centre) @ view.T * scale
    p[:, :2] = p[:, :2] * [1, -1] + size / 2
    light = np.array([-0.4, 0.6, 0.7]) / np.linalg.norm([-0.4, 0.6, 0.7])
    if len(triangles) == 0:
        r = max(1.0, point_radius)
        for x, y, z in p[np.argsort(p[:, 2])]:
            ys, xs = np.mgrid[int(y - r):int(y + r) + 2, int(x - r):int(x + r) + 2]
            inside = (xs - x) ** 2 + (ys - y) ** 2 <= r * r
            ys, xs = ys[inside].clip(0, size - 1), xs[inside].clip(0, size - 1)
            shade = 0.75 - 0.5 * (z / (0.5 * size)).clip(-1, 1) / 2
            image[ys, xs] = np.array([40, 90, 160]) * (1.25 - shade) + 60 * shade
        return image
    corners = p[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) * [1, -1, 1]
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
    lit = np.abs(normals @ light) * 0.75 + 0.25
    low = np.floor(corners.min(1)[:, :2]).astype(int).clip(0, size - 1)
    high = np.ceil(corners.max(1)[:, :2]).astype(int).clip(0, size - 1)
    boxes, group = np.unique(high - low + 1, axis=0, return_inverse=True)
    by_box = np.split(np.argsort(group.ravel(), kind="stable"), np.cumsum(np.bincount(group.ravel()))[:-1])
    for (width, height), members in zip(boxes, by_box):
        ys, xs = np.mgrid[:height, :width].reshape(2, 1, -1)
        at_once = max(1, 1_000_000 // (width * height))
        for chosen in (members[k : k + at_once] for k in range(0, len(members), at_once)):
            pixels(corners[chosen], low[chosen, :1] + xs, low[chosen, 1:] + ys, lit[chosen], image, depth)
    return image


def pixels(corners, xs, ys, lit, image, depth):
    """Paints triangles, a row of `xs` and `ys` each, where they are nearer than what is there."""
    a, b, c = (corners[:, k, :, None] for k in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1])
    area = np.where(np.abs(area) < 1e-12, np.nan, area)
    u = ((b[:, 0] - xs) * (c[:, 1] - ys) - (c[:, 0] - xs) * (b[:, 1] - ys)) / area
    v = ((c[:, 0] - xs) * (a[:, 1] - ys) - (a[:, 0] - xs) * (c[:, 1] - ys)) / area
    z = u * a[:, 2] + v * b[:, 2] + (1 - u - v) * c[:, 2]
    triangle, pixel = np.nonzero((u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (z > depth[ys, xs]))
    nearest_last = np.argsort(z[triangle, pixel], kind="stable")
    triangle, pixel = triangle[nearest_last], pixel[nearest_last]
    place = ys[triangle, pixel], xs[triangle, pixel]
    depth[place] = z[triangle, pixel]
    image[place] = np.array([226, 186, 160]) * lit[triangle, None]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out")
    parser.add_argument("files", nargs="+")
    parser.add_argument("--azimuth", type=float, default=-60)
    parser.add_argument("--elevation", type=float, default=20)
    parser.add_argument("--size", type=int, default=480)
    parser.add_argument("--frame-of-first", action="store_true", help="the first file alone chooses the scale")
    parser.add_argument("--point-radius", type=float, help="in pixels; a 300th of the size unless given")
    parser.add_argument("--tight", action="store_true", help="fills the picture with what is seen from here")
    options = parser.parse_args()
    parts = [read_ply(path) for path in options.files]
    framed = parts[:1] if options.frame_of_first else parts
    low = np.min([v.min(0) for v, _ in framed], 0)
    high = np.max([v.max(0) for v, _ in framed], 0)
    view = camera(options.azimuth, options.elevation)
    oversampling = 2
    size = options.size * oversampling
    centre, extent = (low + high) / 2, np.linalg.norm(high - low)
    if options.tight:
        seen = np.concatenate([v @ view.T for v, _ in framed])
        centre = (seen.min(0) + seen.max(0)) / 2 @ view
        extent = np.ptp(seen[:, :2], axis=0).max()
    scale = 0.92 * size / extent
    radius = oversampling * (options.point_radius or options.size / 300)
    images = [draw(v, t, view, centre, scale, size, radius) for v, t in parts]
    sheet = Image.fromarray(np.concatenate(images, 1).clip(0, 255).astype("uint8"))
    sheet.resize((sheet.width // oversampling, sheet.height // oversampling), Image.LANCZOS).save(options.out)


if __name__ == "__main__":
    main()
