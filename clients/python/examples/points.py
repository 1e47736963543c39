"""Points as a NumPy array in, mesh out: python points.py"""

import sys

import numpy
from meshway_client import Meshway

points = numpy.random.default_rng(7).normal(size=(500, 3))
points /= numpy.linalg.norm(points, axis=1, keepdims=True)
mesh = Meshway(*sys.argv[1:]).reconstruct(points, preset="fast")
vertices, triangles = mesh.arrays()
print(mesh.save("mesh.stl"), mesh.verdict, vertices.shape, triangles.shape)
