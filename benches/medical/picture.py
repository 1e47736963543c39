"""The picture of docs/medical.md, of what the bench left behind: picture.py FOLDER OUT.png

A row a case: the truth, flying edges with windowed sinc as in 3D Slicer, meshway.
"""

import pathlib
import subprocess
import sys

import numpy as np
import solids
import vtk
from PIL import Image
from vtk.util.numpy_support import numpy_to_vtk

RENDER = pathlib.Path(__file__).resolve().parents[2] / "scripts" / "render.py"

# Case: azimuth and elevation.
CASES = {"organ-5": (-50, 15)}
TRUTH_SPACING = 0.8


def truth(name, path):
    f, box = solids.SOLIDS[name][0]()
    low, high = (np.asarray(corner, float) for corner in box)
    low, high = low - 2, high + 2
    size = np.ceil((high - low) / TRUTH_SPACING).astype(int)
    axes = [low[axis] + TRUTH_SPACING * np.arange(size[axis]) for axis in range(3)]
    values = np.empty(size, np.float32)
    for k, height in enumerate(axes[2]):
        values[:, :, k] = -f(np.stack(np.meshgrid(axes[0], axes[1], [height], indexing="ij"), -1))[:, :, 0]
    image = vtk.vtkImageData()
    image.SetDimensions(size)
    image.SetSpacing([TRUTH_SPACING] * 3)
    image.SetOrigin(low)
    image.GetPointData().SetScalars(numpy_to_vtk(values.ravel(order="F"), deep=True))
    surface = vtk.vtkFlyingEdges3D()
    surface.SetInputData(image)
    surface.SetValue(0, 0)
    surface.ComputeNormalsOff()
    surface.ComputeScalarsOff()
    writer = vtk.vtkPLYWriter()
    writer.SetFileName(str(path))
    writer.SetInputConnection(surface.GetOutputPort())
    writer.Write()


def main():
    folder, out = (pathlib.Path(path) for path in sys.argv[1:])
    rows = []
    for case, (azimuth, elevation) in CASES.items():
        exact, row = folder / f"{case}-truth.ply", folder / f"{case}.png"
        truth(case.partition("-")[0], exact)
        meshes = [exact, folder / f"{case}-flying_edges_+_sinc.ply", folder / f"{case}-meshway.ply"]
        command = [sys.executable, RENDER, row, *meshes, f"--azimuth={azimuth}", f"--elevation={elevation}"]
        subprocess.run([*command, "--size=320", "--tight", "--frame-of-first"], check=True)
        rows.append(Image.open(row))
    sheet = Image.new("RGB", (max(row.width for row in rows), sum(row.height for row in rows)), "white")
    for k, row in enumerate(rows):
        sheet.paste(row, (0, sum(above.height for above in rows[:k])))
    sheet.save(out, optimize=True)


if __name__ == "__main__":
    main()
