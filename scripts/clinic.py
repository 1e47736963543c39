"""Asks a served instance for the files of a job and reads them with the programs of others."""

import ctypes
import io
import json
import sys
import urllib.error
import urllib.request
from pathlib import Path

import lib3mf
import nibabel
import numpy
import pydicom
import SimpleITK
import vtk
from vtk.util.numpy_support import vtk_to_numpy

address, folder = sys.argv[1], Path(sys.argv[2])


def call(path, body=None, **headers):
    request = urllib.request.Request(address + path, body, headers)
    with urllib.request.urlopen(request) as answer:
        return answer.read()


def fetched(job, name, query=""):
    """A file of a job, in the folder."""
    path = folder / (query.replace("?space=", "") + name)
    path.write_bytes(call(f"/v1/jobs/{job}/{name}{query}"))
    return str(path)


def run(cloud):
    """A small job; its id."""
    settings = json.dumps({"cloud_id": cloud, "preset": "fast", "settings": {
        "training": {"max_evaluations": 60}, "surface": {"resolution": 40}}}).encode()
    job = json.loads(call("/v1/jobs", settings, Prefer="wait=60", **{"Content-Type": "application/json"}))
    assert job["status"] == "succeeded", job
    return job["id"]


def read(reader, path):
    reader.SetFileName(path)
    reader.Update()
    return reader.GetOutput()


def volume(vertices, triangles):
    a, b, c = (vertices[triangles[:, i]].astype(float) for i in range(3))
    return numpy.einsum("ij,ij->i", a, numpy.cross(b, c)).sum() / 6


def polygons(data):
    points = vtk_to_numpy(data.GetPoints().GetData())
    cells = vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return points, cells


def meshes(job):
    """Every format in every frame: the same vertices, the same handedness, the frame where programs look for it."""
    points, cells = polygons(read(vtk.vtkPLYReader(), fetched(job, "mesh.ply")))
    whole = volume(points, cells)
    assert whole > 0, whole
    for query, space, turn in [("", "LPS", [1, 1, 1]), ("?space=ras", "RAS", [-1, -1, 1])]:
        expected = points * numpy.array(turn, points.dtype)

        def check(what, found, triangles):
            assert len(triangles) == len(cells), what
            # STL has no shared vertices, and readers merge them in an order of their own.
            found_corners, corners = found[triangles], expected[cells]
            assert numpy.abs(found_corners - corners).max() < 1e-5, what
            assert abs(volume(found, triangles) / whole - 1) < 1e-5, what

        ply = vtk.vtkPLYReader()
        check("ply", *polygons(read(ply, fetched(job, "mesh.ply", query))))
        comments = ply.GetComments()
        comments = [comments.GetValue(i) for i in range(comments.GetNumberOfValues())]
        assert any(f"SPACE={space}" in comment for comment in comments), comments
        stl = vtk.vtkSTLReader()
        check("stl", *polygons(read(stl, fetched(job, "mesh.stl", query))))
        assert f"SPACE={space}" in stl.GetHeader(), stl.GetHeader()
        obj = vtk.vtkOBJReader()
        check("obj", *polygons(read(obj, fetched(job, "mesh.obj", query))))
        assert f"SPACE={space}" in obj.GetComment(), obj.GetComment()
        vtp = read(vtk.vtkXMLPolyDataReader(), fetched(job, "mesh.vtp", query))
        check("vtp", *polygons(vtp))
        named = vtp.GetFieldData().GetAbstractArray("SPACE")
        assert isinstance(named, vtk.vtkStringArray) and named.GetValue(0) == space
        distances = vtk_to_numpy(vtp.GetPointData().GetArray("distance_to_points"))
        assert len(distances) == len(points) and 0 <= distances.min() < distances.max()
        outward = numpy.einsum("ij,ij->i", vtk_to_numpy(vtp.GetPointData().GetNormals()), expected - expected.mean(0))
        assert outward.mean() > 0
        check("3mf", *printed(fetched(job, "mesh.3mf", query)))
    glb = vtk.vtkGLTFReader()
    upright = read(glb, fetched(job, "mesh.glb")).GetBlock(0)
    while isinstance(upright, vtk.vtkMultiBlockDataSet):
        upright = upright.GetBlock(0)
    found, _ = polygons(upright)
    expected = points[:, [0, 2, 1]] * [1e-3, 1e-3, -1e-3]
    assert numpy.abs(found - expected).max() < 1e-6
    return len(points), len(cells)


def printed(path):
    wrapper = lib3mf.Wrapper()
    model = wrapper.CreateModel()
    reader = model.QueryReader("3mf")
    reader.ReadFromFile(path)
    assert reader.GetWarningCount() == 0, reader.GetWarning(0)
    assert model.GetUnit() == lib3mf.ModelUnit.MilliMeter
    objects = model.GetMeshObjects()
    objects.MoveNext()
    mesh = objects.GetCurrentMeshObject()
    assert mesh.IsManifoldAndOriented()
    vertices = numpy.array([list(vertex.Coordinates) for vertex in mesh.GetVertices()])
    return vertices, numpy.array([list(triangle.Indices) for triangle in mesh.GetTriangleIndices()])


def archived(job):
    """The DICOM file: what pydicom reads and writes again is the same, and holds the STL in LPS."""
    path = fetched(job, "mesh.dcm")
    file = pydicom.dcmread(path)
    assert file.SOPClassUID.name == "Encapsulated STL Storage", file.SOPClassUID.name
    stl = (folder / "mesh.stl").read_bytes()
    assert file.EncapsulatedDocument == stl and file.EncapsulatedDocumentLength == len(stl)
    unit = file.MeasurementUnitsCodeSequence[0]
    assert (unit.CodeValue, unit.CodingSchemeDesignator) == ("mm", "UCUM")
    assert file.PatientName == "" and file.PatientID == ""
    for name in ["SOPInstanceUID", "SeriesInstanceUID", "StudyInstanceUID", "FrameOfReferenceUID"]:
        assert file[name].value.is_valid and file[name].value.startswith("2.25."), name
    again = io.BytesIO()
    pydicom.dcmwrite(again, file, enforce_file_format=True)
    assert pydicom.dcmread(io.BytesIO(again.getvalue())) == file


def label_map():
    """A body with a thumb to the left and one to the front, on an oblique left-handed grid, as NIfTI."""
    turned, _ = numpy.linalg.qr(numpy.array([[1.0, 0.2, -0.1], [0.1, 1.0, 0.3], [-0.2, 0.1, 1.0]]))
    turned *= numpy.sign(numpy.diag(turned))
    size = numpy.array([48, 40, 22])
    affine = numpy.eye(4)
    affine[:3, :3] = turned @ numpy.diag([-0.9, 1.1, 2.0])
    affine[:3, 3] = [31.0, -17.0, 210.0] - affine[:3, :3] @ (size - 1) / 2
    places = numpy.indices(size).reshape(3, -1)
    ras = affine[:3, :3] @ places + affine[:3, 3:]
    body = numpy.zeros(ras.shape[1], bool)
    for centre, radius in [((31, -17, 210), 10), ((20, -17, 213), 5), ((33, -6, 206), 4)]:
        body |= numpy.linalg.norm(ras - numpy.array(centre)[:, None], axis=0) < radius
    image = nibabel.Nifti1Image(body.reshape(size).astype(numpy.uint8), affine)
    image.set_sform(affine, 1)
    nibabel.save(image, folder / "body.nii.gz")
    return image


def masks():
    """A label map becomes a mesh and a mask: the same voxels, the same side of the patient, for all readers."""
    image = label_map()
    truth = image.get_fdata() > 0
    try:
        cloud = json.loads(call("/v1/clouds", (folder / "body.nii.gz").read_bytes()))
    except urllib.error.HTTPError as refused:
        assert refused.code == 415, refused.read()
        return "left out, this version reads no label maps"
    job = run(cloud["id"])
    mask = nibabel.load(fetched(job, "mask.nii.gz"))
    assert mask.shape == image.shape and mask.get_data_dtype() == numpy.uint8
    assert numpy.abs(mask.affine - image.affine).max() < 1e-4 and mask.header["sform_code"] > 0
    found = mask.get_fdata() > 0
    dice = 2 * (found & truth).sum() / (found.sum() + truth.sum())
    assert dice > 0.93, dice
    vertices, triangles = polygons(read(vtk.vtkSTLReader(), fetched(job, "mesh.stl")))
    corners = vertices[triangles].astype(float)
    sixths = numpy.einsum("ij,ij->i", corners[:, 0], numpy.cross(corners[:, 1], corners[:, 2])) / 6
    middle = (corners.sum(1) / 4 * sixths[:, None]).sum(0) / sixths.sum()
    index = numpy.argwhere(found).mean(0)
    expected = nibabel.affines.apply_affine(mask.affine, index) * [-1, -1, 1]
    assert numpy.abs(middle - expected).max() < 0.3, (middle, expected)
    image = SimpleITK.ReadImage(str(folder / "mask.nii.gz"))
    placed = image.TransformContinuousIndexToPhysicalPoint(index.tolist())
    assert numpy.abs(middle - placed).max() < 0.3, (middle, placed)
    archived(job)
    return f"Dice {dice:.3f}"


cloud = (folder / "hand.ply").read_bytes()
cloud = cloud.replace(b"element vertex", b"comment SPACE=LPS\nelement vertex", 1)
cloud = json.loads(call("/v1/clouds", cloud))
assert (cloud["frame"], cloud["unit"]) == ("lps", "mm"), cloud
job = run(cloud["id"])
vertices, triangles = meshes(job)
print(f"VTK {vtk.vtkVersion().GetVTKVersion()}, lib3mf: {vertices} vertices, {triangles} triangles, in every format and frame")
archived(job)
print(f"pydicom {pydicom.__version__}: read and written again")
print(f"nibabel {nibabel.__version__}, SimpleITK {SimpleITK.Version_VersionString()}: a mask on the voxels of its source, "
      f"{masks()}")
