"""glTF accessors: typed, possibly strided, sparse or normalised views of a buffer."""

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from model.errors import UnreadableMeshError
from model.types import AnyArray

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_MOST_ABSENT = 1 << 24  # values of an accessor without data, which a few bytes of JSON can ask for

View: TypeAlias = Callable[[int], tuple[bytes, int, int, int]]


def read_accessor(document: Any, index: int, width: int, view: View) -> AnyArray:
    """Values of an accessor, (count, width); normalised integers come as float64.

    Args:
        document: the parsed JSON.
        index: the accessor.
        width: components that are expected of each value.
        view: buffer, first byte, end and stride (0 if packed) of a buffer view.

    Raises:
        UnreadableMeshError: the accessor is of another width, or reaches beyond its buffer view.
    """
    accessor = document["accessors"][index]
    count = int(accessor["count"])
    dtype = np.dtype(_COMPONENTS[accessor["componentType"]])
    if _WIDTHS[accessor["type"]] != width or count < 0:
        raise UnreadableMeshError("The glTF file has positions or indices of the wrong type.")
    if "bufferView" in accessor:
        values = _strided(view(accessor["bufferView"]), int(accessor.get("byteOffset", 0)), count, width, dtype)
    elif count <= _MOST_ABSENT:
        values = np.zeros((count, width), dtype)
    else:
        raise UnreadableMeshError("The glTF file has a huge accessor without data.")
    if "sparse" in accessor:
        sparse = accessor["sparse"]
        changed = int(sparse["count"])
        where, what = sparse["indices"], sparse["values"]
        places = _strided(
            view(where["bufferView"]),
            int(where.get("byteOffset", 0)),
            changed,
            1,
            np.dtype(_COMPONENTS[where["componentType"]]),
        ).reshape(-1)
        values = values.copy()
        values[places] = _strided(view(what["bufferView"]), int(what.get("byteOffset", 0)), changed, width, dtype)
    return normalized(values, accessor)


def normalized(values: AnyArray, accessor: Any) -> AnyArray:
    """Integers of an accessor as fractions of the largest one where it says so (float64), else as they are."""
    dtype = np.dtype(_COMPONENTS[accessor["componentType"]])
    if accessor.get("normalized", False) and dtype.kind in "iu" and values.dtype.kind in "iu":
        return np.maximum(values / float(np.iinfo(dtype).max), -1.0)
    return values


def _strided(place: tuple[bytes, int, int, int], offset: int, count: int, width: int, dtype: np.dtype[Any]) -> AnyArray:
    buffer, start, end, stride = place
    size = width * dtype.itemsize
    stride = stride or size
    start += offset
    if offset < 0 or count < 0 or stride < size or (count and start + (count - 1) * stride + size > end):
        raise UnreadableMeshError("The glTF file has an accessor beyond its buffer view.")
    if count == 0:
        return np.empty((0, width), dtype)
    if stride == size:
        return np.frombuffer(buffer, dtype, count * width, start).reshape(count, width)
    return np.ndarray((count, width), dtype, buffer, start, (stride, dtype.itemsize))
