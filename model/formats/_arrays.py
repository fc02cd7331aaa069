"""Arrays of numpy (NPY, NPZ) and surveys (LAS): points in rows."""

import zipfile
from io import BytesIO

import numpy as np

from model.errors import MeshTooLargeError, UnreadableMeshError
from model.formats._common import Limits, RawMesh, Reader, alone, no_faces
from model.types import AnyArray

_POINT_NAMES = ("points", "point", "pos", "xyz", "pc", "pcd", "vertices", "verts", "vertex", "arr_0")
_FACE_NAMES = ("faces", "face", "triangles")
_MOST_MEMBERS = 1000
_LAS_HEADER = 227


def is_npy(data: bytes) -> bool:
    """Whether it begins with the magic string."""
    return data.startswith(b"\x93NUMPY")


def is_npz(data: bytes) -> bool:
    """Whether it is a zip archive whose first file is an array."""
    return data.startswith(b"PK\x03\x04") and data[30 : 30 + int.from_bytes(data[26:28], "little")].endswith(b".npy")


def is_las(data: bytes) -> bool:
    """Whether it begins with the signature."""
    return data.startswith(b"LASF")


def read_npy(data: bytes, limits: Limits) -> RawMesh:
    """One array of numbers ``(n, 3)`` or wider; x, y and z come first. Objects are never unpickled."""
    return RawMesh(_points(_array(data, limits)), no_faces())


def read_npz(data: bytes, limits: Limits) -> RawMesh:
    """The array called points (or xyz, vertices, ...) or else the first that holds points, with triangles in faces."""
    with zipfile.ZipFile(BytesIO(data)) as archive:
        members = [info for info in archive.infolist() if info.filename.endswith(".npy")]
        if len(members) > _MOST_MEMBERS:
            raise UnreadableMeshError("The archive holds more arrays than a point cloud needs.")
        if sum(info.file_size for info in members) > limits.max_unpacked_bytes:
            raise MeshTooLargeError(f"The archive unpacks to more than {limits.max_unpacked_bytes} bytes.")
        arrays: dict[str, AnyArray] = {}
        for info in members:
            with archive.open(info) as member:
                content = member.read(info.file_size + 1)
            if len(content) != info.file_size:
                raise UnreadableMeshError("The archive is damaged.")
            if not _is_object(content):
                arrays[info.filename[:-4].lower()] = _array(content, limits)
    named = [arrays[name] for name in _POINT_NAMES if name in arrays and _is_points(arrays[name])]
    found = named or [array for array in arrays.values() if _is_points(array)]
    if not found:
        raise UnreadableMeshError("The archive holds no array of points, (n, 3) numbers.")
    faces = next((arrays[name] for name in _FACE_NAMES if name in arrays), no_faces())
    if faces.dtype.kind not in "iu" or faces.ndim != 2 or faces.shape[1] != 3:
        faces = no_faces()
    limits.check(faces=len(faces))
    return RawMesh(_points(found[0]), np.ascontiguousarray(faces).astype(np.int32))


def read_las(data: bytes, limits: Limits) -> RawMesh:
    """Versions 1.0 to 1.4, any point format; packed files (LAZ) are refused."""
    if len(data) < _LAS_HEADER:
        raise UnreadableMeshError("The LAS file has no complete header.")
    start = int.from_bytes(data[96:100], "little")
    kind, length = data[104], int.from_bytes(data[105:107], "little")
    count = int.from_bytes(data[107:111], "little")
    if count == 0 and data[25] >= 4 and len(data) >= 255:
        count = int.from_bytes(data[247:255], "little")
    if kind >= 128:
        raise UnreadableMeshError("The LAS file is packed (LAZ); unpack it, with laszip for example.")
    limits.check(vertices=count)
    if length < 12 or start + count * length > len(data):
        raise UnreadableMeshError("The LAS file is shorter than its header says.")
    rows = np.frombuffer(data, np.uint8, count * length, start).reshape(count, length)
    whole = np.ascontiguousarray(rows[:, :12]).view("<i4")
    scale, offset = np.frombuffer(data, "<f8", 3, 131), np.frombuffer(data, "<f8", 3, 155)
    return RawMesh(whole * scale + offset, no_faces())


def _array(data: bytes, limits: Limits) -> AnyArray:
    """The array of a NPY file, without a copy where it lies in the order of its rows."""
    stream = BytesIO(data[: 1 << 16])
    version = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, by_columns, dtype = read(stream)
    if dtype.hasobject or dtype.kind not in "iuf" or not 1 <= len(shape) <= 4 or min(shape) < 0:
        return np.empty(0)
    count = 1
    for size in shape:
        count *= size
    limits.check(vertices=shape[0] if len(shape) == 2 and shape[1] >= 3 else 0)
    if count * dtype.itemsize > len(data) - stream.tell():
        raise UnreadableMeshError("The array is shorter than its header says.")
    values = np.frombuffer(data, dtype, count, stream.tell())
    return values.reshape(shape[::-1]).T if by_columns else values.reshape(shape)


def _is_object(data: bytes) -> bool:
    return b"'|O'" in data[:128]


def _is_points(array: AnyArray) -> bool:
    return array.ndim == 2 and array.shape[1] >= 3 and array.dtype.kind in "iuf"


def _points(array: AnyArray) -> AnyArray:
    if not _is_points(array):
        raise UnreadableMeshError("The array does not hold points: it has to be (n, 3) numbers.")
    return np.ascontiguousarray(array[:, :3]).astype(np.float64)


READERS = {
    "npy": Reader(alone(read_npy), is_npy),
    "npz": Reader(alone(read_npz), is_npz),
    "las": Reader(alone(read_las), is_las),
}
