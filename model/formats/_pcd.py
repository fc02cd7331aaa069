"""PCD, the format of the Point Cloud Library: ASCII, binary, and binary compressed with LZF."""

import re

import numpy as np

from model._jit import jit
from model.errors import MeshTooLargeError, UnreadableMeshError
from model.formats._common import Limits, RawMesh, Reader, alone, no_faces, to_float64
from model.formats._text import as_bytes, parse_numbers
from model.types import AnyArray, ByteArray

_LONGEST_HEADER = 1 << 16
_MOST_FIELDS = 1000
_KINDS = {"I": "i", "U": "u", "F": "f"}
_SIZES = {"i": (1, 2, 4, 8), "u": (1, 2, 4, 8), "f": (4, 8)}
_SHORT = "The PCD file is shorter than its header says."


def is_pcd(data: bytes) -> bool:
    """Whether it begins as a header does."""
    return re.match(rb"(#[^\n]*\n\s*)*(VERSION[ \t]+[.0-9]+|# \.PCD)", data[:4096]) is not None


def read_pcd(data: bytes, limits: Limits) -> RawMesh:
    """The fields x, y and z; places without a point (NaN), as organised clouds have them, count as broken."""
    header, start = _header(data)
    names, sizes, kinds = (header.get(key, []) for key in ("FIELDS", "SIZE", "TYPE"))
    counts = [_whole(word) for word in header.get("COUNT", ["1"] * len(names))]
    points = _whole((header.get("POINTS") or ["-1"])[0])
    if points < 0:
        points = _whole((header.get("WIDTH") or ["0"])[0]) * _whole((header.get("HEIGHT") or ["1"])[0])
    limits.check(vertices=points)
    if not len(names) == len(sizes) == len(kinds) == len(counts) or not 0 < sum(counts) <= _MOST_FIELDS:
        raise UnreadableMeshError("The PCD header does not say of every field what it is.")
    if any(name not in names for name in "xyz") or min(counts) < 1:
        raise UnreadableMeshError("The PCD file has points without x, y or z.")
    first = [sum(counts[: names.index(name)]) for name in "xyz"]
    how = (header.get("DATA") or [""])[0]
    if how == "ascii":
        return RawMesh(_text(data[start:], sum(counts), points)[:, first], no_faces())
    types = [_type(kind, size) for kind, size in zip(kinds, sizes, strict=True)]
    if how == "binary":
        dtype = np.dtype([(f"f{k}", kind, (count,)) for k, (kind, count) in enumerate(zip(types, counts, strict=True))])
        if points * dtype.itemsize > len(data) - start:
            raise UnreadableMeshError(_SHORT)
        rows = np.frombuffer(data, dtype, points, start)
        columns = [rows[f"f{names.index(name)}"][:, 0] for name in "xyz"]
    elif how == "binary_compressed":
        columns = _compressed(data[start:], names, types, counts, points, limits)
    else:
        raise UnreadableMeshError("The PCD header names no way its data are written that is known.")
    return RawMesh(to_float64(columns), no_faces())


def _header(data: bytes) -> tuple[dict[str, list[str]], int]:
    """The words behind each keyword, and where the data start."""
    header: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in header:
        end = data.find(b"\n", at, _LONGEST_HEADER)
        if end < 0:
            raise UnreadableMeshError("The PCD file has no complete header.")
        words = data[at:end].decode("latin-1").split()
        if words and not words[0].startswith("#"):
            header[words[0].upper()] = words[1:]
        at = end + 1
    return header, at


def _whole(word: str) -> int:
    if not re.fullmatch(r"-?[0-9]{1,15}", word):
        raise UnreadableMeshError("The PCD header has a count that is no number.")
    return int(word)


def _type(kind: str, size: str) -> str:
    code = _KINDS.get(kind.upper(), "")
    if not code or _whole(size) not in _SIZES[code]:
        raise UnreadableMeshError("The PCD header has a field of a type that does not exist.")
    return f"<{code}{size}"


def _text(data: bytes, width: int, points: int) -> AnyArray:
    numbers, _ = parse_numbers(as_bytes(data))
    if len(numbers) < points * width:
        raise UnreadableMeshError(_SHORT)
    return numbers[: points * width].reshape(points, width)


def _compressed(
    data: bytes, names: list[str], types: list[str], counts: list[int], points: int, limits: Limits
) -> list[AnyArray]:
    """The columns x, y and z of data that are packed field after field."""
    sizes = np.frombuffer(data, "<u4", 2) if len(data) >= 8 else np.zeros(2, dtype=np.uint32)
    packed, unpacked = int(sizes[0]), int(sizes[1])
    widths = [np.dtype(kind).itemsize * count for kind, count in zip(types, counts, strict=True)]
    if len(data) < 8 + packed or unpacked < points * sum(widths):
        raise UnreadableMeshError(_SHORT)
    if unpacked > limits.max_unpacked_bytes:
        raise MeshTooLargeError(f"The PCD file unpacks to more than {limits.max_unpacked_bytes} bytes.")
    # What LZF cannot reach: a reference of three bytes stands for 264 at most.
    if unpacked > 100 * packed + 264:
        raise UnreadableMeshError("The PCD file is packed smaller than it can be.")
    plain = np.empty(unpacked, dtype=np.uint8)
    if not _unpack(np.frombuffer(data, np.uint8, packed, 8), plain):
        raise UnreadableMeshError("The packed data of the PCD file are damaged.")
    columns: list[AnyArray] = []
    for name in "xyz":
        field = names.index(name)
        column = plain[points * sum(widths[:field]) :][: points * widths[field]].view(types[field])
        columns.append(column.reshape(points, counts[field])[:, 0])
    return columns


@jit
def _unpack(packed: ByteArray, plain: ByteArray) -> bool:
    """LZF: runs of bytes as they are, and references to what was written before. False unless it fits exactly."""
    at, to, end, room = 0, 0, packed.shape[0], plain.shape[0]
    while at < end:
        control = int(packed[at])
        at += 1
        if control < 32:
            length = control + 1
            if at + length > end or to + length > room:
                return False
            for _ in range(length):
                plain[to] = packed[at]
                at += 1
                to += 1
        else:
            length = (control >> 5) + 2
            if length == 9:
                if at >= end:
                    return False
                length += int(packed[at])
                at += 1
            if at >= end:
                return False
            back = to - ((control & 31) << 8) - int(packed[at]) - 1
            at += 1
            if back < 0 or to + length > room:
                return False
            for k in range(length):
                plain[to] = plain[back + k]
                to += 1
    return to == room


READERS = {"pcd": Reader(alone(read_pcd), is_pcd, may_be_text=True)}
