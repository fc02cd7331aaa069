"""The looks of an OBJ file: its library of materials (.mtl), places in pictures, and what they make of its mesh."""

import re
from dataclasses import dataclass, replace

import numpy as np

from model._jit import jit
from model.formats._common import RawMesh, Resources
from model.formats._text import parse_number, parse_numbers
from model.meshes.texture import MOST_PICTURES, Picture, lost_pictures, picture, texture
from model.types import AnyArray, ByteArray, FloatArray, IntArray

_LIBRARY = re.compile(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", re.MULTILINE)
_USE = re.compile(rb"^[ \t]*usemtl[ \t]+(.+?)[ \t\r]*$", re.MULTILINE)
_PLACE = re.compile(rb"^[ \t]*vt[ \t]", re.MULTILINE)
_MOST_MATERIALS = 10_000
_WHITE = (255, 255, 255, 255)


@dataclass(slots=True)
class _Material:
    """``color`` is sRGB with opacity; ``picture`` the name of a file, empty for none."""

    color: tuple[int, int, int, int] = _WHITE
    picture: str = ""


def is_painted(data: bytes, resources: Resources) -> bool:
    """Whether the materials of an OBJ file give it several colours or pictures, as far as can be told."""
    if b"usemtl" not in data:
        return False
    if len({match.group(1) for match in _USE.finditer(data)}) > 1:
        return True
    return any(material.picture for material in _library(data, resources).values())


def with_looks(
    data: bytes, raw: RawMesh, polygon_starts: AnyArray, lengths: AnyArray, places: IntArray, resources: Resources
) -> RawMesh:
    """A mesh with the colours and pictures of its materials, as far as they are at hand.

    Vertices where materials or parts of a picture meet become several, at one place.

    Args:
        data: the text, its lines ended as on Unix.
        raw: the mesh without.
        polygon_starts: (p,) where the line of each polygon is in the text.
        lengths: (p,) its corners.
        places: (f, 3) where the corners of the triangles are in the row of all corners of polygons.
        resources: the files that the text may name.
    """
    library = _library(data, resources)
    if not library:
        return raw
    names = [match.group(1) for match in _USE.finditer(data)]
    starts = np.array([match.start() for match in _USE.finditer(data)], dtype=np.int64)
    materials = [_Material(), *(library.get(_decoded(name), _Material()) for name in names)]
    of_polygon = np.searchsorted(starts, polygon_starts)  # 0: before any material
    polygons = np.searchsorted(np.cumsum(lengths), places[:, 0], side="right")
    pictures, numbers = _pictures(materials, resources)
    lost = len({each.picture for each, number in zip(materials, numbers, strict=True) if each.picture and number < 0})
    kinds = [(material.color, number) for material, number in zip(materials, numbers, strict=True)]
    distinct = sorted(set(kinds))
    kind = np.array([distinct.index(each) for each in kinds])[of_polygon][polygons]
    laid = np.full(places.shape, -1, dtype=np.int64)
    coordinates = np.zeros((0, 2))
    if pictures:
        coordinates, corners = _laid(data, int(lengths.sum()))
        laid = np.where(np.array([number >= 0 for _, number in distinct])[kind][:, None], corners[places], -1)
        laid[laid >= len(coordinates)] = -1
    vertices, first, faces = split_vertices(raw.faces, kind, laid, len(distinct), len(coordinates))
    of_corner, at = kind[first // 3], laid.reshape(-1)[first]
    where = np.where((at >= 0)[:, None], coordinates[at] if len(coordinates) else 0.0, 0.0)
    colors = np.array([color for color, _ in distinct], dtype=np.uint8)[of_corner]
    of_face = np.array([number for _, number in distinct], dtype=np.int32)[kind]
    return replace(
        raw,
        vertices=raw.vertices[vertices],
        faces=faces,
        colors=colors if raw.colors is None else raw.colors[vertices],
        texture=texture(where, of_face, pictures),
        painted=False,
        warnings=(*raw.warnings, *lost_pictures(lost)),
    )


def split_vertices(
    faces: IntArray, kind: AnyArray, laid: AnyArray, kinds: int, places: int
) -> tuple[AnyArray, AnyArray, IntArray]:
    """Vertices for every combination of vertex, kind of material and place: of which vertex, at which corner, faces.

    Args:
        faces: (f, 3); negative where broken.
        kind: (f,) of the material, less than ``kinds``.
        laid: (f, 3) which place each corner has, less than ``places``, -1 for none.
        kinds: how many there are.
        places: how many there are.
    """
    broken = (faces < 0).any(axis=1)  # left for others to find
    keys = (faces.astype(np.int64) * kinds + kind[:, None]) * (places + 1) + laid + 1
    keys[broken] = -1
    _, first, inverse = np.unique(keys.reshape(-1), return_index=True, return_inverse=True)
    numbers = inverse.reshape(-1, 3).astype(np.int32)
    vertices = np.maximum(faces.reshape(-1)[first], 0)
    numbers[broken] = -1
    return vertices, first, np.ascontiguousarray(numbers)


def _pictures(materials: list[_Material], resources: Resources) -> tuple[list[Picture], list[int]]:
    """The pictures at hand, and which of them each material has, -1 for none."""
    pictures, known = list[Picture](), dict[str, int]({"": -1})
    for material in materials:
        if material.picture not in known:
            found = picture(resources(material.picture)) if len(pictures) < MOST_PICTURES else None
            known[material.picture] = -1 if found is None else len(pictures)
            pictures += [] if found is None else [found]
    return pictures, [known[material.picture] for material in materials]


def _library(data: bytes, resources: Resources) -> dict[str, _Material]:
    """The materials of the files that the text names, by name."""
    materials: dict[str, _Material] = {}
    for match in _LIBRARY.finditer(data):
        name = _decoded(match.group(1))
        content = resources(name)
        for part in name.split() if content is None else ():  # several files, or a name with blanks
            _read_library(resources(part) or b"", materials)
        _read_library(content or b"", materials)
    return materials


def _read_library(content: bytes, materials: dict[str, _Material]) -> None:
    current = _Material()
    for line in content.decode("utf-8", "replace").splitlines():
        word, _, rest = line.strip().partition(" ")
        rest = rest.strip()
        match word.lower():
            case "newmtl" if len(materials) < _MOST_MATERIALS:
                current = materials[rest] = _Material()
            case "kd" if not current.picture:
                red, green, blue = _fractions(rest, 3)
                current.color = (red, green, blue, current.color[3])
            case "d" if rest and not rest.startswith("-"):
                red, green, blue, _ = current.color
                current.color = (red, green, blue, _fractions(rest, 1)[0])
            case "map_kd" if rest:
                # Kd beside a picture is written as black, white or grey by different programs: the picture decides.
                current.picture = rest.split()[-1] if rest.startswith("-") else rest
                current.color = (255, 255, 255, current.color[3])
            case _:
                pass


def _fractions(text: str, count: int) -> list[int]:
    """Numbers from 0 to 1 as 0 to 255; 255 where there are fewer."""
    numbers: FloatArray = parse_numbers(np.frombuffer(text.encode(), dtype=np.uint8), stop_at_junk=True)[0][:count]
    found = (
        np.clip(np.rint(255.0 * np.nan_to_num(numbers, nan=1.0, posinf=1.0, neginf=0.0)), 0, 255).astype(int).tolist()
    )
    return [*found, *[255] * (count - len(found))]


def _decoded(name: bytes) -> str:
    return name.decode("utf-8", "replace")


def _laid(data: bytes, corners: int) -> tuple[FloatArray, AnyArray]:
    """Places in pictures (k, 2), and which of them each corner of a polygon has (corners,), -1 for none."""
    coordinates = np.zeros((len(_PLACE.findall(data)), 2))
    found = np.full(corners, -1, dtype=np.int64)
    _read_places(np.frombuffer(data, dtype=np.uint8), coordinates, found)
    coordinates[:, 1] = 1.0 - coordinates[:, 1]  # OBJ counts from below
    return coordinates, found


@jit
def _read_places(data: ByteArray, coordinates: FloatArray, found: AnyArray) -> None:
    """Fill in the numbers of lines ``vt``, and what stands behind the first slash of the corners of lines ``f``."""
    at, end, place, corner = 0, data.shape[0], 0, 0
    while at < end:
        while at < end and (data[at] == 32 or data[at] == 9):
            at += 1
        if at + 2 < end and data[at] == 118 and data[at + 1] == 116 and data[at + 2] <= 32:
            at += 2
            for axis in range(2):
                while at < end and (data[at] == 32 or data[at] == 9):
                    at += 1
                value, after = parse_number(data, at, end)
                if after > at and place < coordinates.shape[0]:
                    coordinates[place, axis] = value
                at = after
            place += 1
        elif at + 1 < end and data[at] == 102 and (data[at + 1] == 32 or data[at + 1] == 9):
            at += 1
            while at < end and data[at] != 10 and data[at] != 35:
                if data[at] <= 32 or (data[at] == 92 and at + 1 < end and data[at + 1] <= 32):
                    at += 1 if data[at] <= 32 else 2
                    while data[at - 1] == 13 and at < end and data[at] == 10:
                        at += 1
                    continue
                while at < end and data[at] > 32 and data[at] != 47:
                    at += 1
                negative, number, digits = False, 0, 0
                if at < end and data[at] == 47:
                    at += 1
                    if at < end and data[at] == 45:
                        negative = True
                        at += 1
                    while at < end and 48 <= data[at] <= 57:
                        number = min(number * 10 + np.int64(data[at] - 48), np.int64(1) << 31)
                        digits += 1
                        at += 1
                if digits and corner < found.shape[0]:
                    found[corner] = place - number if negative else number - 1
                corner += 1
                while at < end and data[at] > 32:
                    at += 1
        while at < end and data[at] != 10:
            at += 1
        at += 1
