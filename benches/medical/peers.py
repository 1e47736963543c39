"""What VTK makes of a label map: peers.py VOLUME.nii.gz STEM

Writes STEM-NAME.ply for each of its ways, in LPS, and prints name and seconds. Windowed sinc as 3D Slicer calls it for
its smoothing factor of 0.5, which is its default; SurfaceNets with 8 iterations, fewer than VTK's 16, with which it
shrinks bodies twice as much.
"""

import json
import sys
import time

import nibabel
import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk

SMOOTHING = 0.5


def image(path):
    volume = nibabel.load(path)
    mask = np.asarray(volume.dataobj, np.uint8)
    affine = np.diag([-1.0, -1.0, 1.0, 1.0]) @ volume.affine
    made = vtk.vtkImageData()
    made.SetDimensions(mask.shape)
    made.SetSpacing(np.abs(np.diag(affine)[:3]))
    made.SetOrigin(affine[:3, 3])
    made.GetPointData().SetScalars(numpy_to_vtk(mask.ravel(order="F"), deep=True))
    return made


def sinc(source):
    smooth = vtk.vtkWindowedSincPolyDataFilter()
    smooth.SetInputConnection(source.GetOutputPort())
    smooth.SetNumberOfIterations(20)
    smooth.SetPassBand(10 ** (-4 * SMOOTHING))
    smooth.BoundarySmoothingOff()
    smooth.FeatureEdgeSmoothingOff()
    smooth.NonManifoldSmoothingOn()
    smooth.NormalizeCoordinatesOn()
    return smooth


def marching_cubes(volume):
    made = vtk.vtkDiscreteMarchingCubes()
    made.SetInputData(volume)
    made.SetValue(0, 1)
    return sinc(made)


def flying_edges(volume):
    made = vtk.vtkDiscreteFlyingEdges3D()
    made.SetInputData(volume)
    made.SetValue(0, 1)
    return sinc(made)


def surface_nets(volume):
    made = vtk.vtkSurfaceNets3D()
    made.SetInputData(volume)
    made.SetValue(0, 1)
    made.SetNumberOfIterations(8)
    return made


WAYS = {"marching cubes + sinc": marching_cubes, "flying edges + sinc": flying_edges, "SurfaceNets": surface_nets}


def main():
    path, stem = sys.argv[1:]
    for name, way in WAYS.items():
        started = time.monotonic()
        triangles = vtk.vtkTriangleFilter()
        made = way(image(path))
        triangles.SetInputConnection(made.GetOutputPort())
        triangles.Update()
        seconds = time.monotonic() - started
        writer = vtk.vtkPLYWriter()
        writer.SetFileName(f"{stem}-{name.replace(' ', '_')}.ply")
        writer.SetInputConnection(triangles.GetOutputPort())
        writer.Write()
        print(json.dumps({"tool": name, "seconds": seconds, "mesh": writer.GetFileName()}))


if __name__ == "__main__":
    main()
