"""Writes binary PLY: clouds and triangle meshes, coordinates in single precision."""

import numpy as np


def write(path, points, triangles=None):
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    head += [f"property float {axis}" for axis in "xyz"]
    if triangles is not None:
        head += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
    with open(path, "wb") as file:
        file.write("\n".join([*head, "end_header\n"]).encode())
        file.write(np.asarray(points, "<f4").tobytes())
        if triangles is not None:
            rows = np.empty(len(triangles), [("count", "u1"), ("corners", "<i4", 3)])
            rows["count"], rows["corners"] = 3, triangles
            file.write(rows.tobytes())
