"""Buffer views compressed with meshoptimizer, as `EXT_meshopt_compression` of glTF describes them (version 0)."""

from typing import Any

import numpy as np

from model._jit import jit, jit_allocating
from model.errors import UnreadableMeshError, UnsupportedFormatError
from model.types import AnyArray

_DENSEST = 256
"""So many times its own size a view may unpack to: more than the format can do."""

_DAMAGED = "The glTF file has meshopt data that cannot be decoded."
_DECODE_FIRST = (
    "The glTF file is compressed with meshopt in a way that is not supported; "
    'decompress it with "gltf-transform copy in.glb out.glb".'
)


def decode_view(view: Any, data: bytes) -> bytes:
    """The bytes of a buffer view; ``view`` is the extension's object, ``data`` what it points to.

    Raises:
        UnreadableMeshError: the data are damaged.
        UnsupportedFormatError: they are of a newer version or go through a filter that positions do not have.
    """
    count, stride, mode = int(view["count"]), int(view["byteStride"]), view["mode"]
    size = count * stride
    if count < 0 or not 0 < stride <= 256 or size > _DENSEST * (len(data) + 1) or not data:
        raise UnreadableMeshError(_DAMAGED)
    source = np.frombuffer(data, np.uint8).astype(
        np.int16
    )  # signed: unsigned and signed numbers make floats in kernels
    if mode == "ATTRIBUTES":
        if source[0] != 0xA0:
            raise UnsupportedFormatError(_DECODE_FIRST)
        result = np.zeros((count, stride), np.int16)
        _require(stride % 4 == 0 and _decode_attributes(source, result))
        return _filtered(view.get("filter", "NONE"), result.astype(np.uint8))
    if stride not in (2, 4):
        raise UnreadableMeshError(_DAMAGED)
    indices = np.zeros(count, np.int64)
    if mode == "TRIANGLES" and source[0] in (0xE0, 0xE1):
        _require(count % 3 == 0 and _decode_triangles(source, indices))
    elif mode == "INDICES" and source[0] in (0xD0, 0xD1):
        _require(bool(_decode_sequence(source, indices)))
    else:
        raise UnsupportedFormatError(_DECODE_FIRST)
    return indices.astype("<u2" if stride == 2 else "<u4").tobytes()


def warm_up_kernels() -> None:
    """Compile or load the kernels of formats for which no small file is at hand."""
    nothing = {"count": 0, "byteStride": 4}
    for mode, header in (("ATTRIBUTES", 0xA0), ("TRIANGLES", 0xE1), ("INDICES", 0xD1)):
        decode_view({**nothing, "mode": mode}, bytes([header]) + b"\0" * 40)


def _require(decoded: bool) -> None:
    if not decoded:
        raise UnreadableMeshError(_DAMAGED)


def _filtered(name: str, values: AnyArray) -> bytes:
    """Positions are stored as they are or with an exponent; the other filters are for normals and rotations."""
    if name == "EXPONENTIAL":
        packed = values.view("<i4")
        with np.errstate(over="ignore"):
            return np.ldexp(((packed << 8) >> 8).astype(np.float32), packed >> 24).astype("<f4").tobytes()
    if name == "QUATERNION":
        return _quaternions(values.view("<i2"))
    # Octahedral normals are never read here.
    return values.tobytes()


def _quaternions(packed: AnyArray) -> bytes:
    """Rotations of 16-bit numbers: three components, and in the fourth their scale and which one is left out."""
    last = packed[:, 3].astype(np.int64)
    scale = (last | 3).astype(np.float64)
    three = packed[:, :3] / (scale[:, None] * np.sqrt(2.0))
    largest = np.sqrt(np.maximum(0.0, 1.0 - (three * three).sum(axis=1)))
    result = np.empty((len(packed), 4))
    rows = np.arange(len(packed))
    for place in range(3):
        result[rows, (last + 1 + place) & 3] = three[:, place]
    result[rows, last & 3] = largest
    return np.rint(result * 32767.0).astype("<i2").tobytes()


@jit
def _decode_attributes(data: AnyArray, result: AnyArray) -> bool:
    """Blocks of elements, byte by byte of the element, as differences to the element before."""
    count, stride = result.shape
    tail = max(stride, 32)
    at, end = 1, data.shape[0] - tail
    if end < 1:
        return False
    most = min((8192 // stride) & ~15, 256)
    first = 0
    while first < count:
        size = min(most, count - first)
        groups = (size + 15) // 16
        for byte in range(stride):
            last = int(data[data.shape[0] - stride + byte] if first == 0 else result[first - 1, byte])
            header = at
            at += (groups + 3) // 4
            if at > end:
                return False
            for group in range(groups):
                mode = (data[header + group // 4] >> ((group % 4) * 2)) & 3
                bits = 0 if mode == 0 else 1 << mode  # 0, 2, 4 and 8 bits a difference
                extra = at + 2 * bits
                if extra > end:
                    return False
                for place in range(16):
                    value = 0
                    if bits == 8:
                        value = int(data[at + place])
                    elif bits > 0:
                        within = place * bits
                        value = (int(data[at + within // 8]) >> (8 - bits - within % 8)) & ((1 << bits) - 1)
                        if value == (1 << bits) - 1:
                            if extra >= end:
                                return False
                            value = int(data[extra])
                            extra += 1
                    element = group * 16 + place
                    if element < size:
                        last = (last + _unzigzag(value)) & 255
                        result[first + element, byte] = last
                at = extra
        first += size
    return True


@jit
def _varint(data: AnyArray, at: int, end: int) -> tuple[int, int]:
    """A number in groups of seven bits, and the place after it; -1 for that where the data end too early."""
    value, shift = 0, 0
    while at < end and shift < 35:
        byte = int(data[at])
        at += 1
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            return value & 0xFFFFFFFF, at
    return 0, -1


@jit
def _unzigzag(value: int) -> int:
    return (value >> 1) ^ -(value & 1)


@jit
def _decode_sequence(data: AnyArray, result: AnyArray) -> bool:
    at, end = 1, data.shape[0] - 4
    first, second = 0, 0
    for index in range(result.shape[0]):
        value, at = _varint(data, at, end)
        if at < 0:
            return False
        step = _unzigzag(value >> 1)
        if value & 1:
            second = (second + step) & 0xFFFFFFFF
            result[index] = second
        else:
            first = (first + step) & 0xFFFFFFFF
            result[index] = first
    return True


@jit_allocating
def _decode_triangles(data: AnyArray, result: AnyArray) -> bool:
    """Triangles by the edges and vertices of those before them, which are kept in two rings of sixteen."""
    edges = np.zeros((16, 2), np.int64)
    vertices = np.zeros(16, np.int64)
    count = result.shape[0] // 3
    end = data.shape[0] - 16  # where a table of sixteen frequent codes stands
    at = 1 + count
    if at > end:
        return False
    most = 13 if data[0] & 15 >= 1 else 15
    edge, vertex, following, last = 0, 0, 0, 0
    for triangle in range(count):
        code = int(data[1 + triangle])
        if code < 0xF0:
            # The next corner of an edge that is known.
            a, b = edges[(edge - 1 - (code >> 4)) & 15]
            low = code & 15
            if low < most:
                fresh = low == 0
                c = following if fresh else vertices[(vertex - 1 - low) & 15]
                following += fresh
            else:
                fresh = True
                if low == 15:
                    value, at = _varint(data, at, end)
                    if at < 0:
                        return False
                    last += _unzigzag(value)
                else:
                    last += 1 if low == 14 else -1
                last &= 0xFFFFFFFF
                c = last
            if fresh:
                vertices[vertex & 15] = c
                vertex += 1
            edges[edge & 15, 0], edges[edge & 15, 1] = c, b
            edges[(edge + 1) & 15, 0], edges[(edge + 1) & 15, 1] = a, c
            edge += 2
        else:
            if code < 0xFE:
                low = int(data[end + (code & 15)])
                first = 0
            else:
                if at >= end:
                    return False
                low = int(data[at])
                at += 1
                first = 0 if code == 0xFE else 15
                if low == 0:
                    following = 0
            corners = (first, low >> 4, low & 15)
            a, b, c = 0, 0, 0
            pushed = 0
            for place in range(3):
                kind = corners[place]
                if kind == 0:
                    value = following
                    following += 1
                elif kind < 15 or code < 0xFE:
                    value = vertices[(vertex - kind) & 15]
                else:
                    value = -1
                if place == 0:
                    a = value
                elif place == 1:
                    b = value
                else:
                    c = value
            if code >= 0xFE:
                for place in range(3):
                    if corners[place] == 15:
                        value, at = _varint(data, at, end)
                        if at < 0:
                            return False
                        last = (last + _unzigzag(value)) & 0xFFFFFFFF
                        if place == 0:
                            a = last
                        elif place == 1:
                            b = last
                        else:
                            c = last
            for place in range(3):
                kind = corners[place]
                if place == 0 or kind == 0 or (kind == 15 and code >= 0xFE):
                    vertices[(vertex + pushed) & 15] = a if place == 0 else b if place == 1 else c
                    pushed += 1
            vertex += pushed
            edges[edge & 15, 0], edges[edge & 15, 1] = b, a
            edges[(edge + 1) & 15, 0], edges[(edge + 1) & 15, 1] = c, b
            edges[(edge + 2) & 15, 0], edges[(edge + 2) & 15, 1] = a, c
            edge += 3
        result[3 * triangle] = a
        result[3 * triangle + 1] = b
        result[3 * triangle + 2] = c
    return True
