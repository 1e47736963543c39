"""What may be given as a cloud, and the arrays of a mesh."""

from __future__ import annotations

import io
import os
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Any, Union

if TYPE_CHECKING:
    import numpy

    Points = Union[str, "os.PathLike[str]", bytes, IO[bytes], "numpy.ndarray[Any, Any]"]

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip


@dataclass(frozen=True)
class Source:
    """A file to send; a path is opened anew for each try."""

    name: str
    content: Union[bytes, str]

    def open(self) -> Union[bytes, IO[bytes]]:
        """Its bytes, or the open file."""
        return self.content if isinstance(self.content, bytes) else open(self.content, "rb")

    def length(self) -> int:
        """Number of its bytes."""
        return len(self.content) if isinstance(self.content, bytes) else os.path.getsize(self.content)

    def part(self, at: int, most: int) -> bytes:
        """Bytes from a place on, at most so many."""
        if isinstance(self.content, bytes):
            return self.content[at : at + most]
        with open(self.content, "rb") as file:
            file.seek(at)
            return file.read(most)

    def ending(self) -> str:
        """What its name says of the format: all behind the first dot."""
        ending = self.name.partition(".")[2]
        return ending if ending.replace(".", "").isalnum() and ending.isascii() else ""


def source_of(cloud: Any, name: str | None = None) -> Source:
    """The file for a path, bytes, a file object or an array of points.

    The columns of an array are x y z or x y z nx ny nz. A name says what the format is where the content
    leaves it open.
    """
    if isinstance(cloud, (str, os.PathLike)):
        path = os.fspath(cloud)
        return Source(name or os.path.basename(path), path)
    if isinstance(cloud, (bytes, bytearray, memoryview)):
        return Source(name or "cloud", bytes(cloud))
    if hasattr(cloud, "read"):
        content = cloud.read()
        if not isinstance(content, bytes):
            raise TypeError("the file is open as text; open it with mode 'rb'")
        given = getattr(cloud, "name", None)
        return Source(name or (os.path.basename(given) if isinstance(given, str) else "cloud"), content)
    if hasattr(cloud, "__array__") or isinstance(cloud, (list, tuple)):
        return Source("cloud.npy", _npy(cloud))
    raise TypeError(
        f"a cloud is a path, bytes, a file open for reading bytes or an array of points, not {type(cloud).__name__}"
    )


def _npy(points: Any) -> bytes:
    import numpy

    array = numpy.asarray(points)
    if array.ndim != 2 or array.shape[1] not in (3, 6):
        raise ValueError(f"an array of points has the shape (n, 3), or (n, 6) with normals, not {array.shape}")
    if array.dtype.kind != "f":
        array = array.astype(numpy.float64)
    file = io.BytesIO()
    numpy.save(file, numpy.ascontiguousarray(array), allow_pickle=False)
    return file.getvalue()


def arrays_of(ply: bytes) -> tuple[Any, Any]:
    """Vertices (n, 3) as floats and triangles (m, 3) as integers of a binary PLY of the service."""
    import numpy

    end = ply.index(b"end_header\n") + len(b"end_header\n")
    lines = [line.split() for line in ply[:end].decode("ascii", "replace").splitlines()]
    order = {"binary_little_endian": "<", "binary_big_endian": ">"}[_format(lines)]
    counts: dict[str, int] = {}
    fields: dict[str, list[Any]] = {}
    element = ""
    for words in lines:
        if words[:1] == ["element"]:
            element = words[1]
            counts[element], fields[element] = int(words[2]), []
        elif words[:2] == ["property", "list"]:
            fields[element].append(("count", order + _TYPES[words[2]]))
            fields[element].append((words[4], order + _TYPES[words[3]], (3,)))
        elif words[:1] == ["property"]:
            fields[element].append((words[2], order + _TYPES[words[1]]))
    vertices = numpy.frombuffer(ply, numpy.dtype(fields["vertex"]), counts["vertex"], end)
    faces = numpy.frombuffer(ply, numpy.dtype(fields["face"]), counts["face"], end + vertices.nbytes)
    if not (faces["count"] == 3).all():
        raise ValueError("the mesh has faces that are no triangles")
    corners = next(name for name in faces.dtype.names or () if name != "count")
    places = numpy.stack([vertices[axis] for axis in "xyz"], axis=1).astype(numpy.float64)
    return places, faces[corners].astype(numpy.int64)


def _format(lines: list[list[str]]) -> str:
    return next((words[1] for words in lines if words[:1] == ["format"]), "")
