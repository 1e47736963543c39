"""Closed surfaces from points or a segment, made by a Meshway service: a scripted module of 3D Slicer."""

import struct

import numpy
import qt
import slicer
import vtk
from slicer.ScriptedLoadableModule import (
    ScriptedLoadableModule,
    ScriptedLoadableModuleLogic,
    ScriptedLoadableModuleWidget,
)
from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray

#: Slicer's coordinates are RAS; files, and the service, have LPS.
TURN = numpy.array([-1.0, -1.0, 1.0])
SETTINGS = "Meshway"


class Meshway(ScriptedLoadableModule):
    def __init__(self, parent):
        super().__init__(parent)
        parent.title = "Meshway"
        parent.categories = ["Surface Models"]
        parent.dependencies = []
        parent.contributors = ["Meshway"]
        parent.helpText = (
            "Sends a point list or a segment to a Meshway service and shows the closed surface that it makes. "
            "The data leave this computer if the service is on another. No medical device."
        )


class MeshwayWidget(ScriptedLoadableModuleWidget):
    def setup(self):
        super().setup()
        form = qt.QFormLayout()
        self.layout.addLayout(form)
        stored = qt.QSettings()
        self.address = qt.QLineEdit(stored.value(f"{SETTINGS}/url", "http://127.0.0.1:8080"))
        form.addRow("Service", self.address)
        self.key = qt.QLineEdit()
        self.key.echoMode = qt.QLineEdit.Password
        form.addRow("Key", self.key)
        self.input = slicer.qMRMLNodeComboBox()
        self.input.nodeTypes = ["vtkMRMLMarkupsFiducialNode", "vtkMRMLSegmentationNode"]
        self.input.addEnabled = self.input.removeEnabled = False
        self.input.setMRMLScene(slicer.mrmlScene)
        form.addRow("Points or segmentation", self.input)
        self.segment = qt.QLineEdit()
        self.segment.placeholderText = "name of the segment; empty: the first"
        form.addRow("Segment", self.segment)
        self.preset = qt.QComboBox()
        self.preset.addItems(["fast", "balanced", "fine"])
        form.addRow("Preset", self.preset)
        self.apply = qt.QPushButton("Make surface")
        self.apply.connect("clicked()", self.onApply)
        form.addRow(self.apply)
        self.layout.addStretch(1)

    def onApply(self):
        qt.QSettings().setValue(f"{SETTINGS}/url", self.address.text)
        with slicer.util.tryWithErrorDisplay("The surface could not be made.", waitCursor=True):
            logic = MeshwayLogic(self.address.text, self.key.text or None)
            logic.reconstruct(
                self.input.currentNode(),
                segment=self.segment.text or None,
                preset=self.preset.currentText,
                tell=lambda text: (slicer.util.showStatusMessage(text), slicer.app.processEvents()),
            )


class MeshwayLogic(ScriptedLoadableModuleLogic):
    """A point list or a segment in, a model node out."""

    def __init__(self, url, key=None):
        super().__init__()
        self.client = client_class()(url, key)

    def reconstruct(self, node, segment=None, preset="fast", tell=lambda text: None):
        """The model node of a surface around the points or the segment of a node."""
        if node is None:
            raise ValueError("choose a point list or a segmentation")
        if node.IsA("vtkMRMLSegmentationNode"):
            cloud, name = self.label_map(node, segment)
            source = {"label": 1}
        else:
            points = numpy.asarray(slicer.util.arrayFromMarkupsControlPoints(node, world=True))
            if len(points) < 16:
                raise ValueError(f"{node.GetName()} has {len(points)} points; at least 16 are needed")
            cloud, name, source = points * TURN, node.GetName(), None
        job = self.client.submit(cloud, preset=preset, source=source)
        for event in self.client.watch(job):
            tell(f"Meshway: {event.kind}")
        mesh = self.client.mesh(self.client.wait(job))
        vertices, triangles = mesh.arrays()
        return self.model(vertices * TURN, triangles, f"{name} surface")

    def label_map(self, node, segment):
        """A segment as NIfTI, whose coordinates are RAS as Slicer's; and its name."""
        if node.GetParentTransformNode() is not None:
            raise ValueError(f"{node.GetName()} is under a transform; harden it first")
        segmentation = node.GetSegmentation()
        if segmentation.GetNumberOfSegments() == 0:
            raise ValueError(f"{node.GetName()} has no segment")
        found = segmentation.GetSegmentIdBySegmentName(segment) if segment else segmentation.GetNthSegmentID(0)
        if not found:
            raise ValueError(f"{node.GetName()} has no segment {segment}")
        volume = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLLabelMapVolumeNode")
        try:
            logic = slicer.modules.segmentations.logic()
            if not logic.ExportSegmentsToLabelmapNode(node, [found], volume):
                raise RuntimeError(f"Slicer gives no label map of segment {found}")
            matrix = vtk.vtkMatrix4x4()
            volume.GetIJKToRASMatrix(matrix)
            content = nifti(slicer.util.arrayFromVolume(volume), slicer.util.arrayFromVTKMatrix(matrix))
        finally:
            slicer.mrmlScene.RemoveNode(volume)
        return content, segmentation.GetSegment(found).GetName()

    def model(self, vertices, triangles, name):
        """A model node of vertices in RAS."""
        points = vtk.vtkPoints()
        points.SetData(numpy_to_vtk(vertices, deep=True))
        cells = numpy.insert(triangles, 0, 3, axis=1).ravel()
        polygons = vtk.vtkCellArray()
        polygons.ImportLegacyFormat(numpy_to_vtkIdTypeArray(cells, deep=True))
        body = vtk.vtkPolyData()
        body.SetPoints(points)
        body.SetPolys(polygons)
        node = slicer.modules.models.logic().AddModel(body)
        node.SetName(name)
        return node


def nifti(voxels, affine):
    """The bytes of a NIfTI-1 file: voxels in the order k, j, i, not zero where the segment is, and the matrix from
    i, j, k to RAS millimetres."""
    k, j, i = voxels.shape
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 3, i, j, k, 1, 1, 1, 1)
    struct.pack_into("<2h", header, 70, 2, 8)  # unsigned bytes
    lengths = numpy.linalg.norm(affine[:3, :3], axis=0)
    struct.pack_into("<4f", header, 76, 1.0, *lengths)
    struct.pack_into("<2f", header, 108, 352.0, 1.0)
    header[123] = 2  # millimetres
    struct.pack_into("<2h", header, 252, 0, 1)  # the matrix below holds, as that of a scanner
    struct.pack_into("<12f", header, 280, *affine[:3].ravel())
    header[344:348] = b"n+1\0"
    return bytes(header) + (voxels != 0).astype("u1").tobytes()


def client_class():
    """The client, which is a package of its own."""
    try:
        from meshway_client import Meshway as Client
    except ImportError as error:
        raise RuntimeError(
            "The client of Meshway is missing. In Slicer's Python console, once: "
            'slicer.util.pip_install("/path/to/meshway/clients/python")'
        ) from error
    return Client
