#!/usr/bin/env python3
"""Segmentations for the tests of the medical readers, and what other readers find in them.

    python scripts/medical.py write FOLDER     writes small files of each format
    python scripts/medical.py read FOLDER      prints what nibabel, pydicom, pynrrd and SimpleITK read

Needs: pip install nibabel pydicom highdicom pynrrd SimpleITK vtk. What `read` prints is kept beside the
files and compared with what Meshway reads, voxel for voxel and contour for contour.
"""

import gzip
import json
import sys
import zlib
from pathlib import Path

import numpy as np

# Oblique steps of different lengths, the third axis the longest: nothing may be swapped unnoticed.
TURN = np.array([[0.96, -0.28, 0.0], [0.28, 0.96, 0.0], [0.0, 0.0, 1.0]])
SPACING = np.array([1.0, 1.5, 4.0])
ORIGIN = np.array([-20.0, 35.0, 100.0])
LPS = np.eye(4)
LPS[:3, :3] = TURN * SPACING
LPS[:3, 3] = ORIGIN
TO_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])


def labels(size=(11, 9, 6)):
    """Two labels, neither with a mirror image of its own."""
    voxels = np.zeros(size, np.uint8)
    voxels[2:9, 2:4, 1:5] = 1
    voxels[2:4, 4:7, 1:3] = 1
    voxels[6:9, 6:8, 2:5] = 5
    return voxels


def write_nifti(folder):
    import nibabel

    voxels, ras = labels(), TO_RAS @ LPS

    def save(name, image, code=(2, 0)):
        image.set_sform(ras, code=code[0])
        image.set_qform(ras, code=code[1])
        nibabel.save(image, folder / name)

    for kind in ("u1", "i1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8"):
        image = nibabel.Nifti1Image(voxels.astype(kind), ras, dtype=kind)
        save(f"nifti1_{kind}.nii.gz", image)
    for order in "<>":
        name = {"<": "little", ">": "big"}[order]
        header = nibabel.Nifti1Header(endianness=order)
        header.set_data_dtype(np.int16)
        save(f"nifti1_{name}.nii.gz", nibabel.Nifti1Image(voxels.astype("i2"), ras, header), (0, 1))
        header = nibabel.Nifti2Header(endianness=order)
        header.set_data_dtype(np.float32)
        save(f"nifti2_{name}.nii.gz", nibabel.Nifti2Image(voxels.astype("f4"), ras, header), (1, 1))
    sheared = ras.copy()
    sheared[:3, 2] += 0.5 * ras[:3, 1]
    image = nibabel.Nifti1Image(voxels, sheared)
    image.set_sform(sheared, code=1)
    image.set_qform(None, code=0)
    nibabel.save(image, folder / "nifti1_sheared.nii.gz")
    mirrored = ras @ np.diag([-1.0, 1.0, 1.0, 1.0])
    image = nibabel.Nifti1Image(voxels, mirrored)
    image.set_sform(mirrored, code=1)
    nibabel.save(image, folder / "nifti1_mirrored.nii.gz")
    image = nibabel.Nifti1Image(voxels, None)
    image.header.set_zooms(SPACING)
    image.set_sform(None, code=0)
    image.set_qform(None, code=0)
    nibabel.save(image, folder / "nifti1_unplaced.nii.gz")
    # nibabel chooses slope and intercept itself, so these are written over the header.
    save("nifti1_scaled.nii", nibabel.Nifti1Image(2 * voxels.astype("i2") + 2, ras))
    plain = folder / "nifti1_scaled.nii"
    data = bytearray(plain.read_bytes())
    data[112:120] = np.array([0.5, -1.0], "<f4").tobytes()
    (folder / "nifti1_scaled.nii.gz").write_bytes(gzip.compress(data, mtime=0))
    plain.unlink()
    # The slices of this one lie across its first axis.
    turned = np.transpose(voxels, (2, 0, 1))
    image = nibabel.Nifti1Image(turned, ras[:, [2, 0, 1, 3]])
    image.set_sform(ras[:, [2, 0, 1, 3]], code=1)
    nibabel.save(image, folder / "nifti1_turned.nii.gz")


def nrrd_text(kind, sizes, space, vectors, origin, encoding, more=()):
    vector = lambda v: "(" + ",".join(repr(float(x)) for x in v) + ")"
    lines = [
        "NRRD0005",
        f"type: {kind}",
        f"dimension: {len(sizes)}",
        *([f"space: {space}"] if space else []),
        "sizes: " + " ".join(map(str, sizes)),
        "space directions: " + " ".join("none" if v is None else vector(v) for v in vectors),
        "endian: little",
        f"encoding: {encoding}",
        "space origin: " + vector(origin),
        *more,
        "",
        "",
    ]
    return "\n".join(lines).encode()


def write_nrrd(folder):
    voxels = labels()
    steps = list(LPS[:3, :3].T)
    raw = voxels.astype("<i2").tobytes(order="F")
    lps = "left-posterior-superior"
    packed = gzip.compress(raw, mtime=0)
    head = lambda encoding, space=lps, vectors=steps, origin=ORIGIN: nrrd_text(
        "short", voxels.shape, space, vectors, origin, encoding
    )
    (folder / "plain.nrrd").write_bytes(head("raw") + raw)
    (folder / "gzip.nrrd").write_bytes(head("gzip") + packed)
    text = " ".join(map(str, voxels.ravel(order="F"))).encode()
    (folder / "text.nrrd").write_bytes(head("ascii") + text)
    ras = (TO_RAS @ LPS)[:3]
    turned = head("gzip", "right-anterior-superior", list(ras[:, :3].T), ras[:, 3])
    (folder / "ras.nrrd").write_bytes(turned + packed)
    (folder / "unplaced.nrrd").write_bytes(head("gzip", None) + packed)
    segments = [
        "Segment0_ID:=Segment_1", "Segment0_Name:=bone", "Segment0_Color:=1 0.5 0",
        "Segment0_LabelValue:=1", "Segment0_Layer:=0",
        "Segment1_ID:=Segment_2", "Segment1_Name:=marrow", "Segment1_Color:=0 0 1",
        "Segment1_LabelValue:=1", "Segment1_Layer:=1",
    ]
    layers = np.stack([voxels == 1, (voxels == 5) | (voxels == 1)]).astype("u1")
    head = nrrd_text("uchar", layers.shape, lps, [None, *steps], ORIGIN, "gzip", segments)
    (folder / "layers.seg.nrrd").write_bytes(head + gzip.compress(layers.tobytes(order="F"), mtime=0))


def write_metaimage(folder):
    voxels = labels()
    # The directions of the axes, one after the other.
    matrix = " ".join(repr(float(v)) for v in TURN.T.ravel())

    def save(name, kind, data, *lines):
        head = [
            "ObjectType = Image", "NDims = 3", "BinaryData = True", *lines,
            f"TransformMatrix = {matrix}", "Offset = " + " ".join(map(str, ORIGIN)),
            "ElementSpacing = " + " ".join(map(str, SPACING)),
            "DimSize = " + " ".join(map(str, voxels.shape)), f"ElementType = {kind}",
            "ElementDataFile = LOCAL", "",
        ]
        (folder / name).write_bytes("\n".join(head).encode() + data)

    order = "BinaryDataByteOrderMSB = "
    save("plain.mha", "MET_UCHAR", voxels.tobytes(order="F"), order + "False")
    save("big.mha", "MET_SHORT", voxels.astype(">i2").tobytes(order="F"), order + "True")
    packed = zlib.compress(voxels.astype("<u4").tobytes(order="F"))
    more = [order + "False", "CompressedData = True", f"CompressedDataSize = {len(packed)}"]
    save("packed.mha", "MET_UINT", packed, *more)


def sources(voxels):
    """The images that a segmentation is of."""
    from pydicom.dataset import Dataset, FileMetaDataset
    from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid

    study, series, frame = (generate_uid(entropy_srcs=[name]) for name in ("study", "series", "frame"))
    images = []
    for k in range(voxels.shape[2]):
        image = Dataset()
        image.file_meta = FileMetaDataset()
        image.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        image.SOPClassUID = CTImageStorage
        image.SOPInstanceUID = generate_uid(entropy_srcs=[f"image {k}"])
        image.StudyInstanceUID, image.SeriesInstanceUID = study, series
        image.FrameOfReferenceUID, image.PositionReferenceIndicator = frame, ""
        image.PatientID, image.PatientName, image.PatientBirthDate, image.PatientSex = "", "", "", ""
        image.StudyDate, image.StudyTime, image.StudyID, image.AccessionNumber = "", "", "", ""
        image.ReferringPhysicianName, image.Modality = "", "CT"
        image.Columns, image.Rows = voxels.shape[0], voxels.shape[1]
        image.BitsAllocated = image.BitsStored = 16
        image.SamplesPerPixel, image.PhotometricInterpretation = 1, "MONOCHROME2"
        image.ImageOrientationPatient = [*TURN[:, 0], *TURN[:, 1]]
        image.PixelSpacing = [SPACING[1], SPACING[0]]
        image.SliceThickness = SPACING[2]
        image.ImagePositionPatient = list((LPS @ [0, 0, k, 1])[:3])
        images.append(image)
    return images


def write_segmentation(folder):
    import highdicom
    import pydicom
    from highdicom.sr.coding import CodedConcept
    from pydicom.uid import (
        DeflatedExplicitVRLittleEndian, ExplicitVRLittleEndian, ImplicitVRLittleEndian, RLELossless,
        generate_uid,
    )

    voxels = labels()
    code = CodedConcept("91723000", "SCT", "Anatomical Structure")
    segment = lambda number, label: highdicom.seg.SegmentDescription(
        segment_number=number, segment_label=label, segmented_property_category=code,
        segmented_property_type=code, algorithm_type="MANUAL",
    )
    # Frames first, rows before columns.
    frames = lambda mask: np.transpose(mask, (2, 1, 0))
    masks = np.stack([frames(voxels == 1), frames(voxels > 0)], axis=-1)

    def save(name, pixels, kind, names, syntax=ExplicitVRLittleEndian, numbers=(1, 2)):
        made = highdicom.seg.Segmentation(
            source_images=sources(voxels), pixel_array=pixels, segmentation_type=kind,
            segment_descriptions=[segment(n, name) for n, name in zip(numbers, names)],
            series_instance_uid=generate_uid(entropy_srcs=["segmentation"]), series_number=1,
            sop_instance_uid=generate_uid(entropy_srcs=[name]), instance_number=1,
            manufacturer="M", manufacturer_model_name="M", software_versions="1",
            device_serial_number="1", transfer_syntax_uid=syntax,
        )
        made.save_as(folder / name)

    both = ("bone", "bone and marrow")
    save("binary.dcm", masks.astype("u1"), "BINARY", both)
    save("implicit.dcm", masks.astype("u1"), "BINARY", both, ImplicitVRLittleEndian)
    save("fractional.dcm", masks[..., :1] * np.float32(0.75), "FRACTIONAL", both[:1])
    save("runs.dcm", masks[..., :1].astype(np.float32), "FRACTIONAL", both[:1], RLELossless)
    save("labelmap.dcm", frames(voxels), "LABELMAP", ("bone", "marrow"), numbers=(1, 5))
    deflated = pydicom.dcmread(folder / "binary.dcm")
    deflated.file_meta.TransferSyntaxUID = DeflatedExplicitVRLittleEndian
    deflated.save_as(folder / "deflated.dcm")


def write_structures(folder):
    from pydicom.dataset import Dataset, FileMetaDataset
    from pydicom.uid import ExplicitVRLittleEndian, ImplicitVRLittleEndian, generate_uid

    def square(side, z, turn=np.eye(3)):
        corners = np.array([[-side, -side, z], [side, -side, z], [side, side, z], [-side, side, z]])
        return np.round((corners + [5, 2, 0]) @ turn.T, 6)

    oblique = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])
    regions = {
        "Shell": [("CLOSED_PLANAR", square(side, z)) for z in (9, 3, 6) for side in (10, 4)],
        "Tilted": [("CLOSED_PLANAR", square(8, z, oblique)) for z in (0, 2, 4)],
        "Marks": [("POINT", square(1, 0)[:1]), ("CLOSED_PLANAR", square(1, 0)[:2])],
        "Nothing": [],
    }
    made = Dataset()
    made.SOPClassUID = "1.2.840.10008.5.1.4.1.1.481.3"
    made.SOPInstanceUID = generate_uid(entropy_srcs=["structures"])
    made.Modality = "RTSTRUCT"
    made.StructureSetROISequence, made.ROIContourSequence = [], []
    for number, (name, contours) in enumerate(regions.items(), 1):
        roi, drawn = Dataset(), Dataset()
        roi.ROINumber, roi.ROIName = number, name
        drawn.ReferencedROINumber, drawn.ROIDisplayColor = number, [255, 40 * number, 0]
        drawn.ContourSequence = []
        for kind, points in contours:
            contour = Dataset()
            contour.ContourGeometricType, contour.NumberOfContourPoints = kind, len(points)
            contour.ContourData = [f"{v:.6f}".rstrip("0") for v in points.ravel()]
            drawn.ContourSequence.append(contour)
        made.StructureSetROISequence.append(roi)
        made.ROIContourSequence.append(drawn)
    # A data set without a mark, as some planning systems write it.
    made.save_as(folder / "bare.dcm", implicit_vr=True, little_endian=True, enforce_file_format=False)
    made.file_meta = FileMetaDataset()
    made.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    made.file_meta.MediaStorageSOPClassUID = made.SOPClassUID
    made.file_meta.MediaStorageSOPInstanceUID = made.SOPInstanceUID
    made.save_as(folder / "structures.dcm", enforce_file_format=True)


def write_polygons(folder):
    import vtk

    sphere = vtk.vtkSphereSource()
    sphere.SetThetaResolution(6)
    sphere.SetPhiResolution(5)
    sphere.SetCenter(10.0, 20.0, 30.0)
    sphere.Update()

    def save(writer, name, *settings):
        for setting, *values in settings:
            getattr(writer, setting)(*values)
        writer.SetInputData(sphere.GetOutput())
        writer.SetFileName(str(folder / name))
        writer.Write()

    save(vtk.vtkPolyDataWriter(), "text.vtk", ["SetFileTypeToASCII"])
    save(vtk.vtkPolyDataWriter(), "binary.vtk", ["SetFileTypeToBinary"])
    save(vtk.vtkPolyDataWriter(), "old.vtk", ["SetFileTypeToBinary"], ["SetFileVersion", 42])
    plain = ["SetCompressorTypeToNone"]
    save(vtk.vtkXMLPolyDataWriter(), "text.vtp", ["SetDataModeToAscii"])
    save(vtk.vtkXMLPolyDataWriter(), "binary.vtp", ["SetDataModeToBinary"], plain)
    save(vtk.vtkXMLPolyDataWriter(), "packed.vtp", ["SetDataModeToBinary"], ["SetCompressorTypeToZLib"])
    appended = ["SetDataModeToAppended"]
    save(vtk.vtkXMLPolyDataWriter(), "raw.vtp", appended, plain, ["EncodeAppendedDataOff"])
    save(
        vtk.vtkXMLPolyDataWriter(), "appended.vtp", appended, ["SetCompressorTypeToZLib"],
        ["EncodeAppendedDataOn"], ["SetHeaderTypeToUInt64"], ["SetByteOrderToBigEndian"],
    )


def voxels_of(indices):
    """Number of voxels, and a sum over them that does not depend on their order."""
    i, j, k = indices.T.astype(np.uint64)
    with np.errstate(over="ignore"):
        mixed = (i + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= (j + np.uint64(1)) * np.uint64(0xC2B2AE3D27D4EB4F)
        mixed ^= (k + np.uint64(1)) * np.uint64(0x165667B19E3779F9)
        mixed *= np.uint64(0xFF51AFD7ED558CCD)
        mixed ^= mixed >> np.uint64(32)
        total = int(np.add.reduce(mixed, dtype=np.uint64))
    return {"voxels": len(indices), "sum": f"{total:016x}"}


def read_grid(voxels, affine):
    """Labels of an array [i, j, k] with an affine to LPS."""
    values = [v for v in np.unique(voxels) if v != 0 and not np.isnan(v)]
    if len(values) > 2048 or any(v != int(v) for v in values):
        return {"refused": "an image"}
    found = {str(int(v)): voxels_of(np.argwhere(voxels == v)) for v in values}
    return {"affine": np.asarray(affine, float)[:3].tolist(), "items": found}


def read_nifti(path):
    import nibabel

    image = nibabel.load(path)
    if not image.header["sform_code"] and not image.header["qform_code"]:
        return {"refused": "no orientation"}
    return read_grid(np.asanyarray(image.dataobj), TO_RAS @ image.affine)


def read_nrrd(path):
    import nrrd

    voxels, header = nrrd.read(str(path))
    if header["encoding"].startswith("bz"):
        return {"refused": "bzip2"}
    directions = np.atleast_2d(header["space directions"])
    space = header.get("space")
    affine = np.eye(4)
    if directions.shape == (4, 4) and "Segmentation_Extent" in header:
        # An old file of 3D Slicer: layers as a fourth axis, the origin that of the whole image.
        affine[:3, :3] = directions[:3, :3].T
        first = np.array(header["Segmentation_Extent"].split(), float)[::2]
        affine[:3, 3] = header["space origin"][:3] + affine[:3, :3] @ first
        layers = np.moveaxis(voxels, 3, 0)
    else:
        kept = ~np.isnan(directions).any(axis=1)
        affine[:3, :3] = directions[kept].T
        affine[:3, 3] = header["space origin"]
        if space is None:
            return {"refused": "no orientation"}
        layers = voxels if voxels.ndim == 4 else voxels[None]
    if space == "right-anterior-superior":
        affine = TO_RAS @ affine
    if len(layers) == 1:
        return read_grid(layers[0], affine)
    items = {str(n): voxels_of(np.argwhere(layer == 1)) for n, layer in enumerate(layers, 1)}
    return {"affine": affine[:3].tolist(), "items": items}


def read_metaimage(path):
    import SimpleITK

    image = SimpleITK.ReadImage(str(path))
    affine = np.eye(4)
    affine[:3, :3] = np.reshape(image.GetDirection(), (3, 3)) * image.GetSpacing()
    affine[:3, 3] = image.GetOrigin()
    return read_grid(np.transpose(SimpleITK.GetArrayFromImage(image)), affine)


def read_dicom(path):
    import pydicom

    data = pydicom.dcmread(path, force=True)
    if "StructureSetROISequence" in data:
        return read_structures(data)
    if not str(data.get("SOPClassUID", "")).startswith("1.2.840.10008.5.1.4.1.1.66."):
        return {"refused": "no segmentation"}
    if "TotalPixelMatrixColumns" in data:
        return {"refused": "a slide"}
    shared, groups = data.SharedFunctionalGroupsSequence[0], data.PerFrameFunctionalGroupsSequence

    def within(group, name):
        return group[name][0] if name in group else shared[name][0]

    if "PlanePositionSequence" not in groups[0] and "PlanePositionSequence" not in shared:
        return {"refused": "not placed"}
    groups = groups[: int(data.get("NumberOfFrames", 1))]
    cosines = np.array(within(groups[0], "PlaneOrientationSequence").ImageOrientationPatient, float)
    spacing = np.array(within(groups[0], "PixelMeasuresSequence").PixelSpacing, float)
    normal = np.cross(cosines[:3], cosines[3:])
    places = [np.array(within(g, "PlanePositionSequence").ImagePositionPatient, float) for g in groups]
    heights = np.round([place @ normal for place in places], 2)
    slices = {height: k for k, height in enumerate(sorted(set(heights)))}
    first = places[int(np.argmin(heights))]
    try:
        pixels = data.pixel_array
    except (NotImplementedError, RuntimeError):
        return {"refused": "not decoded"}
    pixels = pixels[None] if pixels.ndim == 2 else pixels
    items = {}
    for frame, height, group in zip(pixels, heights, groups):
        if data.SegmentationType == "LABELMAP":
            empty = (0, data.get("PixelPaddingValue", 0))
            shown = [(int(v), frame == v) for v in np.unique(frame) if v not in empty]
        else:
            number = within(group, "SegmentIdentificationSequence").ReferencedSegmentNumber
            # Half of it counts, as a surface is laid there.
            least = data.MaximumFractionalValue / 2 if data.SegmentationType == "FRACTIONAL" else 1
            shown = [(int(number), frame >= least)]
        for number, mask in shown:
            rows, columns = np.nonzero(mask)
            index = np.stack([columns, rows, np.full(len(rows), slices[height])], axis=1)
            items.setdefault(str(number), []).append(index)
    items = {number: voxels_of(np.concatenate(all)) for number, all in items.items()}
    items = {number: item for number, item in items.items() if item["voxels"]}
    return {
        "column": (cosines[:3] * spacing[1]).tolist(), "row": (cosines[3:] * spacing[0]).tolist(),
        "origin": first.tolist(), "slices": len(slices), "items": items,
    }


def read_structures(data):
    items = {}
    for drawn in data.get("ROIContourSequence", []):
        contours = []
        for contour in drawn.get("ContourSequence", []):
            if contour.ContourGeometricType in ("CLOSED_PLANAR", "CLOSEDPLANAR_XOR"):
                points = np.array(contour.ContourData, float).reshape(-1, 3)
                # A point that comes again, as at the end of a ring, is one point.
                again = (points == np.roll(points, 1, axis=0)).all(axis=1)
                points = points[~again]
                if len(points) >= 3:
                    contours.append(points)
        if contours:
            all_points = np.concatenate(contours)
            items[str(int(drawn.ReferencedROINumber))] = {
                "contours": len(contours), "points": len(all_points), "total": all_points.sum(0).tolist(),
            }
    return {"items": items}


def read_polygons(path):
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    xml = path.suffix == ".vtp"
    reader = vtk.vtkXMLPolyDataReader() if xml else vtk.vtkDataSetReader()
    reader.SetFileName(str(path))
    reader.Update()
    found = reader.GetOutput()
    if not found.IsA("vtkPolyData"):
        return {"refused": "no polygons"}
    normals = found.GetPointData().GetNormals()

    def total(array):
        """A sum that tells one order from another."""
        vectors = vtk_to_numpy(array).astype(float)
        return (np.arange(1, len(vectors) + 1)[:, None] * vectors).sum(0).tolist()

    points = found.GetPoints().GetData()
    normals = None if normals is None else total(normals)
    return {"points": points.GetNumberOfTuples(), "total": total(points), "normals": normals}


READERS = {".vtk": read_polygons, ".vtp": read_polygons, ".nii": read_nifti, ".nii.gz": read_nifti, ".nrrd": read_nrrd, ".mha": read_metaimage, ".dcm": read_dicom}


def read(folder):
    found = {}
    for path in sorted(folder.iterdir()):
        for ending, reader in READERS.items():
            if path.name.endswith(ending):
                found[path.name] = reader(path)
    lines = (f"{json.dumps(name)}: {json.dumps(item)}" for name, item in found.items())
    print("{\n" + ",\n".join(lines) + "\n}")


def write(folder):
    folder.mkdir(parents=True, exist_ok=True)
    for part in (write_nifti, write_nrrd, write_metaimage, write_segmentation, write_structures, write_polygons):
        part(folder)


if __name__ == "__main__":
    {"write": write, "read": read}[sys.argv[1]](Path(sys.argv[2]))
