"""The logic of the module, with stand-ins for Slicer and a real service at MESHWAY_URL."""

import os
import sys
import types
import unittest
from unittest import mock

import numpy

AFFINE = numpy.array([[-2.0, 0, 0, 40], [0, -2.0, 0, 60], [0, 0, 3.0, -20], [0, 0, 0, 1]])
CENTRE, RADIUS = numpy.array([10.0, 28.0, 15.0]), 18.0


def stand_ins():
    names = ["qt", "slicer", "slicer.ScriptedLoadableModule", "vtk", "vtk.util", "vtk.util.numpy_support"]
    modules = {name: mock.MagicMock(name=name) for name in names}
    base = type("Base", (), {"__init__": lambda self, *given: None})
    for name in ("ScriptedLoadableModule", "ScriptedLoadableModuleLogic", "ScriptedLoadableModuleWidget"):
        setattr(modules["slicer.ScriptedLoadableModule"], name, base)
    modules["vtk.util.numpy_support"].numpy_to_vtk = lambda array, deep: numpy.array(array)
    modules["vtk.util.numpy_support"].numpy_to_vtkIdTypeArray = lambda array, deep: numpy.array(array)
    for name in ("vtkPoints", "vtkCellArray", "vtkPolyData", "vtkMatrix4x4"):
        setattr(modules["vtk"], name, lambda: mock.MagicMock())
    util = modules["slicer"].util
    util.arrayFromMarkupsControlPoints = lambda node, world: node.points
    util.arrayFromVolume = lambda volume: ball()
    util.arrayFromVTKMatrix = lambda matrix: AFFINE
    modules["slicer"].modules.models.logic().AddModel = lambda body: types.SimpleNamespace(
        body=body, SetName=lambda name: None
    )
    return modules


def ball():
    k, j, i = numpy.mgrid[0:24, 0:32, 0:30]
    places = numpy.stack([i, j, k], axis=-1) @ AFFINE[:3, :3].T + AFFINE[:3, 3]
    return (numpy.linalg.norm(places - CENTRE, axis=-1) < RADIUS).astype("i2")


def node(kind, points=None):
    stand_in = mock.MagicMock(points=points)
    stand_in.IsA = lambda name: name == kind
    stand_in.GetName.return_value = "input"
    stand_in.GetParentTransformNode.return_value = None
    stand_in.GetSegmentation().GetNumberOfSegments.return_value = 1
    stand_in.GetSegmentation().GetSegmentIdBySegmentName.return_value = ""
    return stand_in


modules = stand_ins()
sys.modules.update(modules)
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "Meshway"))
import Meshway as module  # noqa: E402


class Logic(unittest.TestCase):
    def setUp(self):
        self.logic = module.MeshwayLogic(os.environ["MESHWAY_URL"])
        self.addCleanup(self.logic.client.close)

    def holds(self, model, tolerance):
        vertices = model.body.SetPoints.call_args[0][0].SetData.call_args[0][0]
        cells = model.body.SetPolys.call_args[0][0].ImportLegacyFormat.call_args[0][0].reshape(-1, 4)
        self.assertTrue((cells[:, 0] == 3).all())
        off = abs(numpy.linalg.norm(vertices - CENTRE, axis=1) - RADIUS)
        self.assertLess(numpy.median(off), tolerance)
        a, b, c = (vertices[cells[:, n]] for n in (1, 2, 3))
        volume = numpy.einsum("ij,ij->i", a - CENTRE, numpy.cross(b - CENTRE, c - CENTRE)).sum() / 6
        self.assertAlmostEqual(volume / (4 / 3 * numpy.pi * RADIUS**3), 1.0, delta=0.15)

    def test_a_segment_becomes_a_model_in_its_place(self):
        told = []
        given = node("vtkMRMLSegmentationNode")
        model = self.logic.reconstruct(given, tell=told.append)
        self.holds(model, tolerance=1.0)
        self.assertIn("Meshway: job.succeeded", told)
        with self.assertRaisesRegex(ValueError, "no segment Liver"):
            self.logic.reconstruct(given, segment="Liver")
        given.GetParentTransformNode.return_value = object()
        with self.assertRaisesRegex(ValueError, "harden"):
            self.logic.reconstruct(given)

    def test_a_point_list_becomes_a_model_in_its_place(self):
        points = numpy.random.default_rng(3).normal(size=(500, 3))
        points = points / numpy.linalg.norm(points, axis=1, keepdims=True) * RADIUS + CENTRE
        self.holds(self.logic.reconstruct(node("vtkMRMLMarkupsFiducialNode", points)), tolerance=1.0)
        with self.assertRaisesRegex(ValueError, "at least 16"):
            self.logic.reconstruct(node("vtkMRMLMarkupsFiducialNode", points[:9]))
        with self.assertRaisesRegex(ValueError, "choose"):
            self.logic.reconstruct(None)


if __name__ == "__main__":
    unittest.main()
