"""3MF: the objects of the build, with components and transforms applied, out of a zip archive."""

import zipfile
import zlib
from dataclasses import replace
from io import BytesIO
from xml.parsers import expat

import numpy as np

from model.errors import MeshTooLargeError, UnreadableMeshError
from model.formats._3mf_looks import Painted, plain, split
from model.formats._3mf_package import Key, Object, Package, Reference
from model.formats._common import Limits, RawMesh, Reader, alone, is_mirror
from model.meshes.clipping import remove_unreferenced_vertices
from model.meshes.texture import lost_pictures, texture
from model.types import FloatArray, IntArray

_SUPPORTS = ("support", "solidsupport")
_NO_SHAPE = "other"


def is_zip(data: bytes) -> bool:
    """Whether the bytes start like a zip archive."""
    return data[:4] == b"PK\x03\x04"


def is_3mf(data: bytes) -> bool:
    """Whether it is a zip archive that has a part of a 3D model, or that cannot be looked into."""
    if not is_zip(data):
        return False
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            names = archive.namelist()
    except (zipfile.BadZipFile, ValueError, EOFError, NotImplementedError, OSError):
        return True  # the reader says what is wrong with it
    return any(name.lower().endswith(".model") for name in names)


def read_3mf(data: bytes, limits: Limits) -> RawMesh:
    """All build items in world coordinates; what only tells a printer how to print is left out."""
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            package = Package(archive, limits)
            package.read_part(package.start)
            for part in package.missing_parts():
                package.read_part(part)
            package.read_slicer_settings()
            if limits.looks:
                package.read_pictures()
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise UnreadableMeshError("The 3MF file is no readable zip archive.") from error
    except (expat.ExpatError, KeyError, ValueError, OverflowError) as error:
        raise UnreadableMeshError("The 3MF file breaks the rules of its format.") from error
    return _Builder(package, limits).build()


class _Builder:
    """Places every object; counted before anything is allocated, because components multiply."""

    def __init__(self, package: Package, limits: Limits) -> None:
        self._objects = package.objects
        self._package = package
        self._roles = package.roles
        self._limits = limits
        self._counts: dict[Key, tuple[int, int, int]] = {}
        self._cache: dict[Key, tuple[FloatArray, IntArray, Painted | None]] = {}
        self._left_out = 0
        self._negative = 0

    def build(self) -> RawMesh:
        """The mesh of all build items."""
        vertices, faces, instances = 0, 0, 0
        for item in self._package.build:
            more = self._count(item.target, ())
            vertices, faces, instances = vertices + more[0], faces + more[1], instances + more[2]
            self._limits.check(vertices, faces, instances)
            if max(vertices, faces) > 2**31 - 1:
                raise MeshTooLargeError("The 3MF file places too many objects.")
        points = np.empty((vertices, 3))
        triangles = np.empty((faces, 3), dtype=np.int32)
        painted = plain(faces if self._limits.looks else 0)
        vertex, face = 0, 0
        waiting = list(reversed(self._package.build))
        while waiting:
            placed = waiting.pop()
            item = self._objects[placed.target]
            if not self._is_shape(item):
                continue
            local, corners, looks = self._arrays(placed.target)
            end = vertex + len(local)
            np.matmul(local, placed.matrix[:3], out=points[vertex:end])
            points[vertex:end] += placed.matrix[3]
            # A transform that mirrors turns the triangles inside out, which the format says to undo.
            mirrored = is_mirror(placed.matrix[:3])
            triangles[face : face + len(corners)] = (corners[:, ::-1] if mirrored else corners) + vertex
            if looks is not None:
                painted.put(face, looks.turned() if mirrored else looks)
            vertex = end
            face += len(corners)
            for component in reversed(self._components(placed.target)):
                matrix = component.matrix @ placed.matrix[:3]
                matrix[3] += placed.matrix[3]
                waiting.append(Reference(component.target, matrix))
        raw = RawMesh(points[:vertex], triangles[:face], self._package.units, self._warnings())
        if not self._limits.looks:
            return replace(raw, painted=self._is_painted())
        return self._with_looks(raw, painted.part(np.arange(len(painted.pictures)) < face))

    def _is_painted(self) -> bool:
        """Whether there are several colours, or pictures, that are not read."""
        palettes = self._package.palettes.values()
        several = self._package.painted and sum(palette.entries for palette in palettes) > 1
        return several or self._package.brushed or any(palette.textures for palette in palettes)

    def _with_looks(self, raw: RawMesh, painted: Painted) -> RawMesh:
        drawn, tinted = bool((painted.pictures >= 0).any()), bool((painted.colors != 255).any())
        if not drawn and not tinted:
            return raw
        which, faces, colors, places = split(raw.faces, painted)
        laid = texture(places, painted.pictures, self._package.pictures)
        return replace(
            raw, vertices=raw.vertices[which], faces=faces, colors=colors if tinted else None, texture=laid
        )  # fmt: skip

    def _warnings(self) -> tuple[str, ...]:
        found: list[str] = []
        if self._left_out:
            found.append(f"Left out: {_volumes(self._left_out)} made only to steer a slicer (modifiers, supports).")
        if self._negative:
            found.append(f"Left out and not subtracted: {_volumes(self._negative)} that a slicer would cut away.")
        if self._limits.looks and self._package.brushed:
            found.append("Left out: the colours that were painted on the surface in a slicer.")
        found += lost_pictures(self._package.lost_pictures)
        if self._package.has_other_shapes:
            found.append("Left out: shapes that are no triangles, such as beam lattices.")
        return tuple(found)

    def _is_shape(self, item: Object) -> bool:
        """Whether an object belongs to the shape; those that do not are counted by the way."""
        if item.kind in _SUPPORTS:
            return False  # as the format says, every reader leaves them out
        if item.kind == _NO_SHAPE or self._roles.is_cura_helper(item.settings):
            self._left_out += 1
            return False
        return True

    def _components(self, key: Key) -> list[Reference]:
        """The components of an object that belong to the shape."""
        item, kept = self._objects[key], list[Reference]()
        for component in item.components:
            role = self._roles.component(key[1], component.target[1]) if key[0] == self._package.start else "shape"
            self._left_out += role == "helper"
            self._negative += role == "negative"
            if role == "shape":
                kept.append(component)
        return kept

    def _arrays(self, key: Key) -> tuple[FloatArray, IntArray, Painted | None]:
        """Vertices, faces, and if they are wanted their looks."""
        if key not in self._cache:
            item = self._objects[key]
            vertices, faces = _arrays(item)
            looks: Painted | None = None
            if self._limits.looks:
                paints = np.array(item.paints, dtype=np.int64).reshape(-1, 4)
                looks = self._package.palettes[key[0]].corners(paints)
            if key[0] == self._package.start:
                kept, helpers, negative = self._roles.triangles(key[1], len(faces))
                if not kept.all():
                    vertices, faces, _ = remove_unreferenced_vertices(vertices, faces[kept])
                    looks = None if looks is None else looks.part(kept)
                self._left_out += helpers
                self._negative += negative
            self._cache[key] = vertices, faces, looks
        return self._cache[key]

    def _count(self, key: Key, path: tuple[Key, ...]) -> tuple[int, int, int]:
        """Vertices, faces and placements of an object with all its components, or more."""
        if key in self._counts:
            return self._counts[key]
        if key in path or len(path) > 100:
            raise UnreadableMeshError("The 3MF file has an object that contains itself.")
        if key not in self._objects:
            raise UnreadableMeshError("The 3MF file refers to an object that does not exist.")
        item = self._objects[key]
        total = (0, 0, 1)
        if item.kind not in _SUPPORTS:
            total = (len(item.vertices) // 3, len(item.faces) // 3, 1)
            for component in item.components:
                more = self._count(component.target, (*path, key))
                total = (total[0] + more[0], total[1] + more[1], total[2] + more[2])
        self._counts[key] = total
        return total


def _volumes(count: int) -> str:
    return "a volume" if count == 1 else f"{count} volumes"


def _arrays(item: Object) -> tuple[FloatArray, IntArray]:
    vertices = np.frombuffer(item.vertices, dtype=np.float64).reshape(-1, 3) if item.vertices else np.empty((0, 3))
    faces = np.array(item.faces, dtype=np.int64).reshape(-1, 3)
    if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise UnreadableMeshError("The 3MF file has a triangle that refers to a vertex that does not exist.")
    return vertices, faces.astype(np.int32)


READERS = {"3mf": Reader(alone(read_3mf), is_3mf)}
