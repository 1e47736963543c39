#!/usr/bin/env python3
"""Holds meshes against a true surface: judge.py TRUTH [MESH...], one line of JSON for the truth and one a mesh.

Distances go from points uniform on one surface to the exact closest point of the other, in % of the diagonal of the
true one. Chamfer: mean of both directed means; Hausdorff-95: the larger 95 % quantile; normals: mean |cosine| at both
ends of the distances, whichever side is out. Needs numpy, scipy, trimesh and open3d.
"""

import argparse
import json

import numpy as np
import open3d
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components


class Surface:
    """Triangles, in a frame where float32 is fine enough to find the closest one."""

    def __init__(self, vertices, triangles, centre, diagonal):
        self.corners = ((vertices - centre) / diagonal)[triangles]
        self.cross = np.cross(self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0])
        self.area = 0.5 * np.linalg.norm(self.cross, axis=1)
        # Triangles without area have no normal and hold no points.
        kept = self.area > 0
        self.corners, self.cross, self.area = self.corners[kept], self.cross[kept], self.area[kept]
        self.normals = self.cross / (2 * self.area)[:, None]
        self.scene = open3d.t.geometry.RaycastingScene()
        soup = self.corners.reshape(-1, 3).astype(np.float32)
        self.scene.add_triangles(soup, np.arange(len(soup), dtype=np.uint32).reshape(-1, 3))

    def sample(self, count, random):
        """Points uniform over the area, and the normals there."""
        triangle = random.choice(len(self.area), count, p=self.area / self.area.sum())
        return points_on(self.corners, triangle, random), self.normals[triangle]

    def closest(self, points):
        """Distances to the surface, and the normals there."""
        found = self.scene.compute_closest_points(points.astype(np.float32))
        triangle, uv = found["primitive_ids"].numpy().astype(int), found["primitive_uvs"].numpy().astype(float)
        a, b, c = (self.corners[triangle, k] for k in range(3))
        # From the place within the triangle, since the point itself is rounded.
        at = a + uv[:, :1] * (b - a) + uv[:, 1:] * (c - a)
        return np.linalg.norm(points - at, axis=1), self.normals[triangle]


def points_on(corners, triangle, random):
    """A point in each of the triangles, uniform."""
    root, share = np.sqrt(random.random((len(triangle), 1))), random.random((len(triangle), 1))
    a, b, c = (corners[triangle, k] for k in range(3))
    return (1 - root) * a + root * (1 - share) * b + root * share * c


def compare(truth, mesh, count, seed):
    random = np.random.default_rng(seed)
    on_mesh, mesh_normals = mesh.sample(count, random)
    on_truth, truth_normals = truth.sample(count, random)
    there, normals_there = truth.closest(on_mesh)
    back, normals_back = mesh.closest(on_truth)
    cosines = [
        np.abs(np.einsum("ij,ij->i", here, other)).mean()
        for here, other in ((mesh_normals, normals_there), (truth_normals, normals_back))
    ]
    return {
        "chamfer": 50 * (there.mean() + back.mean()),
        "hausdorff_95": 100 * max(np.quantile(there, 0.95), np.quantile(back, 0.95)),
        "hausdorff": 100 * max(there.max(), back.max()),
        "normals": float(np.mean(cosines)),
    }


def topology(triangles):
    """Closed: two triangles at each edge; manifold: the triangles at each vertex form one fan as well."""
    origin = triangles.ravel()
    target = np.roll(triangles, -1, 1).ravel()
    low, high = np.minimum(origin, target).astype(np.int64), np.maximum(origin, target)
    edges, edge, sides = np.unique(low * (int(high.max()) + 1) + high, return_inverse=True, return_counts=True)
    closed = bool((sides == 2).all())
    by_edge = np.argsort(edge, kind="stable")
    first = by_edge[:-1][edge[by_edge[1:]] == edge[by_edge[:-1]]]
    second = by_edge[1:][edge[by_edge[1:]] == edge[by_edge[:-1]]]
    # Corner k of a triangle begins its side k. Corners at one vertex belong to one fan where an edge joins them.
    following = np.arange(len(origin)).reshape(-1, 3)[:, [1, 2, 0]].ravel()
    turned = origin[first] == origin[second]
    joined = np.where(turned, second, following[second]), np.where(turned, following[second], second)
    fans = count_parts(len(origin), np.concatenate([first, following[first]]), np.concatenate(joined))
    vertices, corner = np.unique(origin, return_inverse=True)
    parts = count_parts(len(vertices), corner, corner[following])
    result = {
        "triangles": len(triangles),
        "closed": closed,
        "manifold": closed and fans == len(vertices),
        "components": parts,
        "genus": None,
    }
    if result["manifold"]:
        result["genus"] = int(2 * parts - (len(vertices) - len(edges) + len(triangles))) // 2
    return result


def count_parts(size, one, other):
    graph = coo_matrix((np.ones(len(one), bool), (one, other)), shape=(size, size))
    return int(connected_components(graph, directed=False)[0])


def load(path, merge):
    """Files whose vertices are not shared, such as STL, are no meshes before equal ones are merged."""
    mesh = trimesh.load(path, force="mesh", process=False)
    if merge:
        mesh.merge_vertices(merge_norm=True, merge_tex=True)
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("truth")
    parser.add_argument("meshes", nargs="*")
    parser.add_argument("--samples", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    vertices, triangles = load(options.truth, merge=True)
    print(json.dumps(topology(triangles)), flush=True)
    low, high = vertices.min(0), vertices.max(0)
    frame = (low + high) / 2, np.linalg.norm(high - low)
    truth = Surface(vertices, triangles, *frame) if options.meshes else None
    for path in options.meshes:
        vertices, triangles = load(path, merge=False)
        figures = topology(triangles) if len(triangles) else {"triangles": 0}
        if len(triangles):
            figures |= compare(truth, Surface(vertices, triangles, *frame), options.samples, options.seed)
        print(json.dumps(figures), flush=True)


if __name__ == "__main__":
    main()
