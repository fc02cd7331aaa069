"""The looks of a PLY file: the pictures that its comments name, and where its vertices or corners are in them."""

import re
from dataclasses import replace

import numpy as np

from model.formats._common import RawMesh, Resources
from model.formats._obj_looks import split_vertices
from model.formats._ply_tables import Element, Lists
from model.formats._ply_text import Table
from model.meshes.texture import MOST_PICTURES, Picture, lost_pictures, picture, texture
from model.types import AnyArray, BoolArray, ByteArray, FloatArray

_NAME = re.compile(rb"^comment[ \t]+TextureFile[ \t]+(.+?)[ \t\r]*$", re.MULTILINE | re.IGNORECASE)
_PLACES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"), ("tx", "ty"))
_CORNERS, _NUMBER = "texcoord", "texnumber"


def picture_names(header: bytes) -> list[str]:
    """The files with pictures that a header names, in its order."""
    lines = header.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return [match.group(1).decode("utf-8", "replace") for match in _NAME.finditer(lines)][:MOST_PICTURES]


def has_places(element: Element) -> bool:
    """Whether an element says where something is in a picture."""
    if element.name == "vertex":
        return bool(_columns(element))
    return element.name == "face" and element.find(_CORNERS) >= 0


class PlyLooks:
    """Collects the places in pictures while elements are read; without names of pictures it reads nothing."""

    def __init__(self, names: list[str]) -> None:
        self._names = names
        self._vertices: FloatArray | None = None
        self._corners: Lists | None = None
        self._numbers: AnyArray | None = None

    def read_vertices(self, table: Table, element: Element, mark: tuple[int, int]) -> None:
        """Places of vertices, if they have any; the table stands behind the element again afterwards."""
        columns = _columns(element)
        if self._names and columns:
            table.rewind(mark)
            found = table.columns(element, columns)
            if all(len(column) == element.rows for column in found):  # and not lists
                self._vertices = np.stack([column.astype(np.float64) for column in found], axis=1)

    def read_faces(self, table: Table, element: Element, mark: tuple[int, int]) -> None:
        """Places of the corners of faces and numbers of their pictures, if they have any."""
        corners, number = element.find(_CORNERS), element.find(_NUMBER)
        if self._names and corners >= 0 and element.properties[corners].count:
            table.rewind(mark)
            self._corners = table.lists(element, corners)
        if self._names and number >= 0 and not element.properties[number].count:
            table.rewind(mark)
            self._numbers = table.columns(element, [number])[0]

    def laid_on(self, raw: RawMesh, lengths: AnyArray, places: AnyArray | None, resources: Resources) -> RawMesh:
        """The mesh with its pictures, as far as they are at hand; without, as it is.

        Args:
            raw: the mesh.
            lengths: (p,) corners of its polygons.
            places: (f, 3) where corners of triangles are in the row of all corners of polygons; None for 0, 1, 2...
            resources: the files that the header may name.
        """
        if self._vertices is None and self._corners is None:
            return raw
        pictures = list[Picture]()
        known: list[int] = []
        for name in self._names:
            found = picture(resources(name))
            known.append(-1 if found is None else len(pictures))
            pictures += [] if found is None else [found]
        raw = replace(raw, warnings=(*raw.warnings, *lost_pictures(known.count(-1))))
        if not pictures:
            return raw
        where = np.arange(3 * len(raw.faces)).reshape(-1, 3) if places is None else places
        polygons = np.searchsorted(np.cumsum(lengths), where[:, 0], side="right")
        numbers = np.zeros(len(lengths), dtype=np.int64) if self._numbers is None else _whole(self._numbers)
        numbers = np.where((numbers >= 0) & (numbers < len(known)), np.array(known)[numbers % len(known)], -1)
        of_face = numbers[polygons]
        if self._corners is None:
            assert self._vertices is not None
            laid = texture(_from_above(self._vertices), of_face, pictures)
            return replace(raw, texture=laid, colors=_under(raw.colors, raw.faces, of_face))
        return self._cornered(raw, self._corners, lengths, where, polygons, of_face, pictures)

    def _cornered(
        self,
        raw: RawMesh,
        corners: Lists,
        lengths: AnyArray,
        where: AnyArray,
        polygons: AnyArray,
        of_face: AnyArray,
        pictures: list[Picture],
    ) -> RawMesh:
        """With places of corners: vertices where parts of a picture meet become several."""
        whole: BoolArray = np.asarray(corners.lengths) == 2 * np.asarray(lengths)
        of_face = np.where(whole[polygons], of_face, -1)
        first = (np.cumsum(corners.lengths) - corners.lengths)[polygons]
        inside = where - (np.cumsum(lengths) - lengths)[polygons][:, None]
        at = np.where((of_face >= 0)[:, None], first[:, None] + 2 * inside, -1)
        items = np.append(corners.items.astype(np.float64), [0.0, 0.0])
        pairs = np.stack([items[at], items[at + 1]], axis=-1).reshape(-1, 2)
        pairs[at.reshape(-1) < 0] = 0.0
        coordinates, numbers = np.unique(np.nan_to_num(pairs), axis=0, return_inverse=True)
        laid = np.where(at >= 0, numbers.reshape(-1, 3), -1)
        sound: BoolArray = np.asarray(((raw.faces >= 0) & (raw.faces < len(raw.vertices))).all(axis=1))
        own = np.where(sound[:, None], raw.faces, np.int32(-1))  # broken ones are left for others to find
        vertices, corner, faces = split_vertices(own, of_face + 1, laid, len(pictures) + 1, len(coordinates))
        of_vertex = laid.reshape(-1)[corner]
        found = np.where((of_vertex >= 0)[:, None], coordinates[of_vertex], 0.0)
        colors = None if raw.colors is None else raw.colors[vertices]
        return replace(
            raw,
            vertices=raw.vertices[vertices],
            faces=faces,
            colors=_under(colors, faces, of_face),
            texture=texture(_from_above(found), of_face, pictures),
        )


def _columns(element: Element) -> list[int]:
    for names in _PLACES:
        found = [element.find(name) for name in names]
        if min(found) >= 0:
            return found
    return []


def _whole(values: AnyArray) -> AnyArray:
    return np.clip(np.nan_to_num(values.astype(np.float64), nan=-1.0), -1, 1 << 30).astype(np.int64)


def _from_above(places: FloatArray) -> FloatArray:
    """PLY counts from the lower edge of a picture."""
    return places * [1.0, -1.0] + [0.0, 1.0]


def _under(colors: ByteArray | None, faces: AnyArray, of_face: AnyArray) -> ByteArray | None:
    """Colours of vertices without a picture, which they would be multiplied by: programs write both and show one."""
    if colors is None or (of_face >= 0).all():
        return None
    result = colors.copy()
    drawn = faces[of_face >= 0]
    result[drawn[drawn >= 0]] = 255
    return result
