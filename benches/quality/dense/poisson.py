#!/usr/bin/env python3
"""Open3D's Poisson reconstruction of bare points: poisson.py CLOUD STEM DEPTH...

Normals by Open3D's own estimation, their sides by its consistent tangent planes. Writes STEM-DEPTH.ply for each depth
and prints a line of JSON for it: what a run of this depth alone costs, from the reading of the cloud to the written
mesh; the loading of Open3D is not counted. Depths go up, so that the memory of one is not that of the one before.
"""

import json
import resource
import sys
import time

import open3d

# Of the estimation of normals, and of the graph along which they are turned.
NEIGHBOURS, TANGENT_PLANES = 20, 15


def main():
    path, stem, *depths = sys.argv[1:]
    started = clocks()
    cloud = open3d.io.read_point_cloud(path)
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS))
    cloud.orient_normals_consistent_tangent_plane(TANGENT_PLANES)
    oriented = clocks()
    for depth in sorted(map(int, depths)):
        before = clocks()
        mesh, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=depth)
        open3d.io.write_triangle_mesh(f"{stem}-{depth}.ply", mesh)
        own = [after - start for after, start in zip(clocks(), before)]
        shared = [after - start for after, start in zip(oriented, started)]
        costs = dict(zip(("seconds", "cpu_seconds"), map(sum, zip(own, shared))))
        costs["memory_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024e-6
        print(json.dumps({"depth": depth, **costs}), flush=True)


def clocks():
    """On the wall, and of all threads of this process."""
    return time.monotonic(), time.process_time()


if __name__ == "__main__":
    main()
