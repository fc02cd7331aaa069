"""3MF: the objects of the build, with components and transforms applied, out of a zip archive."""

import posixpath
import zipfile
import zlib
from array import array
from collections.abc import Callable
from dataclasses import dataclass, field
from io import BytesIO
from typing import TypeAlias
from xml.parsers import expat

import numpy as np

from model.errors import MeshTooLargeError, UnreadableMeshError
from model.formats._common import Limits, RawMesh, Reader
from model.types import FloatArray, IntArray

_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/"
_PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/"
_RELATIONS = "_rels/.rels"
_DEFAULT_MODEL = "3D/3dmodel.model"
_DEEPEST = 100  # elements within elements; the format needs ten
_CHUNK = 1 << 18
_LONGEST_ELEMENT = 1 << 22
_UNITS = ("micron", "millimeter", "centimeter", "inch", "foot", "meter")

_Key: TypeAlias = tuple[str, str]  # part of the archive, object id


@dataclass(frozen=True, slots=True)
class _Reference:
    """An object placed in another one, or in the build."""

    target: _Key
    matrix: FloatArray  # (4, 3): positions are row vectors, (x, y, z, 1) @ matrix


@dataclass(slots=True)
class _Object:
    kind: str
    vertices: "array[float]" = field(default_factory=lambda: array("d"))
    faces: "array[int]" = field(default_factory=lambda: array("q"))
    components: list[_Reference] = field(default_factory=list[_Reference])


def is_zip(data: bytes) -> bool:
    """Whether the bytes start like a zip archive."""
    return data[:4] == b"PK\x03\x04"


def read_3mf(data: bytes, limits: Limits) -> RawMesh:
    """All build items in world coordinates; support structures are left out."""
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            package = _Package(archive, limits)
            package.read_part(package.start)
            for part in package.missing_parts():
                package.read_part(part)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise UnreadableMeshError("The 3MF file is no readable zip archive.") from error
    except (expat.ExpatError, KeyError, ValueError, OverflowError) as error:
        raise UnreadableMeshError("The 3MF file breaks the rules of its format.") from error
    return _flatten(package.objects, package.build, package.units, limits)


class _Package:
    """The parts of an archive and what was read from them."""

    def __init__(self, archive: zipfile.ZipFile, limits: Limits) -> None:
        self._archive = archive
        self._limits = limits
        self._sizes = {info.filename.lower(): info for info in archive.infolist()}
        self._budget = limits.max_unpacked_bytes
        self._nodes = 0
        self._read: set[str] = set()
        self.objects: dict[_Key, _Object] = {}
        self.build: list[_Reference] = []
        self.units = "millimeter"
        self.start = self._find_start()

    def read_part(self, part: str) -> None:
        """Read the objects of one part, and the build if it is the first."""
        self._read.add(part)
        reader = _PartReader(self, part, self._limits)
        self._parse(part, reader.begin, reader.end)

    def count_node(self) -> None:
        """One more object, component or build item."""
        self._nodes += 1
        self._limits.check(nodes=self._nodes)

    def _too_large(self) -> MeshTooLargeError:
        return MeshTooLargeError(f"The 3MF file unpacks to more than {self._limits.max_unpacked_bytes} bytes.")

    def missing_parts(self) -> list[str]:
        """Other parts that objects refer to; those in turn may not refer further."""
        targets = [entry.target for entry in self.build]
        targets += [entry.target for item in self.objects.values() for entry in item.components]
        return sorted({part for part, _ in targets} - self._read)

    def _find_start(self) -> str:
        """The part that the package names as its model."""
        found: list[str] = []

        def begin(name: str, attributes: dict[str, str]) -> None:
            if name.endswith("Relationship") and attributes.get("Type", "").endswith("/3dmodel"):
                found.append(attributes["Target"])

        if _RELATIONS in self._sizes:
            self._parse(_RELATIONS, begin, _nothing)
        return _part_name(found[0] if found else _DEFAULT_MODEL, "")

    def _parse(self, part: str, begin: Callable[[str, dict[str, str]], None], end: Callable[[str], None]) -> None:
        info = self._sizes.get(part.lower())
        if info is None:
            raise UnreadableMeshError("The 3MF file lacks a part that it refers to.")
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise UnreadableMeshError("The 3MF file is compressed in a way that 3MF does not allow.")
        if info.file_size > self._budget:
            raise self._too_large()
        parser = expat.ParserCreate(namespace_separator=" ")
        depth, fed = 0, 0

        def opened(name: str, attributes: dict[str, str]) -> None:
            nonlocal depth
            depth += 1
            if depth > _DEEPEST:
                raise UnreadableMeshError("The 3MF file nests its elements too deeply.")
            begin(name, attributes)

        def closed(name: str) -> None:
            nonlocal depth
            depth -= 1
            end(name)

        parser.StartElementHandler = opened
        parser.EndElementHandler = closed
        parser.StartDoctypeDeclHandler = _refuse_doctype
        parser.buffer_text = True
        with self._archive.open(info) as stream:
            while chunk := stream.read(_CHUNK):
                self._budget -= len(chunk)
                if self._budget < 0:
                    raise self._too_large()
                fed += len(chunk)
                parser.Parse(chunk, False)
                # The parser reads an unfinished element again with every chunk: a long one would cost its square.
                if fed - parser.CurrentByteIndex > _LONGEST_ELEMENT:
                    raise UnreadableMeshError("The 3MF file has an element that is too long.")
            parser.Parse(b"", True)


def _nothing(_: str) -> None:
    return


def _refuse_doctype(*_: object) -> None:
    raise UnreadableMeshError("The 3MF file has a document type declaration, which 3MF does not allow.")


class _PartReader:
    """Collects objects from the events of one XML part."""

    def __init__(self, package: _Package, part: str, limits: Limits) -> None:
        self._package = package
        self._part = part
        self._limits = limits
        self._object: _Object | None = None

    def begin(self, name: str, attributes: dict[str, str]) -> None:
        """An element starts."""
        namespace, _, local = name.rpartition(" ")
        if namespace and not namespace.startswith(_CORE):
            return
        item = self._object
        if local == "vertex" and item is not None:
            item.vertices.extend((float(attributes["x"]), float(attributes["y"]), float(attributes["z"])))
        elif local == "triangle" and item is not None:
            item.faces.extend((int(attributes["v1"]), int(attributes["v2"]), int(attributes["v3"])))
        elif local == "component" and item is not None:
            item.components.append(self._reference(attributes))
        elif local == "object":
            self._package.count_node()
            self._object = _Object(attributes.get("type", "model"))
            self._package.objects[self._part, attributes["id"]] = self._object
        elif local == "item" and self._part == self._package.start:
            self._package.build.append(self._reference(attributes))
        elif local == "model" and self._part == self._package.start:
            units = attributes.get("unit", "millimeter")
            self._package.units = units if units in _UNITS else "millimeter"

    def end(self, name: str) -> None:
        """An element ends."""
        local = name.rpartition(" ")[2]
        if self._object is not None and local in ("vertices", "triangles", "object"):
            self._limits.check(len(self._object.vertices) // 3, len(self._object.faces) // 3)
        if local == "object":
            self._object = None

    def _reference(self, attributes: dict[str, str]) -> _Reference:
        self._package.count_node()
        paths = [value for name, value in attributes.items() if name.startswith(_PRODUCTION) and name.endswith(" path")]
        part = _part_name(paths[0], self._part) if paths else self._part
        matrix = np.eye(4)[:, :3].copy()
        if "transform" in attributes:
            matrix = np.array(attributes["transform"].split(), dtype=np.float64).reshape(4, 3)
        return _Reference((part, attributes["objectid"]), matrix)


def _part_name(target: str, source: str) -> str:
    """Name of a part inside the archive."""
    return posixpath.normpath(posixpath.join("/", posixpath.dirname(source), target)).lstrip("/")


def _flatten(objects: dict[_Key, _Object], build: list[_Reference], units: str, limits: Limits) -> RawMesh:
    """Place every object; counted before anything is allocated, because components multiply."""
    counts: dict[_Key, tuple[int, int, int]] = {}
    vertices, faces, instances = 0, 0, 0
    for item in build:
        more = _count(objects, item.target, counts, ())
        vertices, faces, instances = vertices + more[0], faces + more[1], instances + more[2]
        limits.check(vertices, faces, instances)
        if max(vertices, faces) > 2**31 - 1:
            raise MeshTooLargeError("The 3MF file places too many objects.")
    points = np.empty((vertices, 3))
    triangles = np.empty((faces, 3), dtype=np.int32)
    cache: dict[_Key, tuple[FloatArray, IntArray]] = {}
    vertex, face = 0, 0
    waiting = list(reversed(build))
    while waiting:
        placed = waiting.pop()
        item = objects[placed.target]
        if _is_support(item):
            continue
        if placed.target not in cache:
            cache[placed.target] = _arrays(item)
        local, corners = cache[placed.target]
        np.matmul(local, placed.matrix[:3], out=points[vertex : vertex + len(local)])
        points[vertex : vertex + len(local)] += placed.matrix[3]
        triangles[face : face + len(corners)] = corners + vertex
        vertex += len(local)
        face += len(corners)
        for component in reversed(item.components):
            matrix = component.matrix @ placed.matrix[:3]
            matrix[3] += placed.matrix[3]
            waiting.append(_Reference(component.target, matrix))
    return RawMesh(points, triangles, units)


def _count(
    objects: dict[_Key, _Object], key: _Key, counts: dict[_Key, tuple[int, int, int]], path: tuple[_Key, ...]
) -> tuple[int, int, int]:
    """Vertices, faces and placements of an object with all its components."""
    if key in counts:
        return counts[key]
    if key in path or len(path) > 100:
        raise UnreadableMeshError("The 3MF file has an object that contains itself.")
    if key not in objects:
        raise UnreadableMeshError("The 3MF file refers to an object that does not exist.")
    item = objects[key]
    total = (0, 0, 1)
    if not _is_support(item):
        total = (len(item.vertices) // 3, len(item.faces) // 3, 1)
        for component in item.components:
            more = _count(objects, component.target, counts, (*path, key))
            total = (total[0] + more[0], total[1] + more[1], total[2] + more[2])
    counts[key] = total
    return total


def _is_support(item: _Object) -> bool:
    return item.kind in ("support", "solidsupport")


def _arrays(item: _Object) -> tuple[FloatArray, IntArray]:
    vertices = np.frombuffer(item.vertices, dtype=np.float64).reshape(-1, 3) if item.vertices else np.empty((0, 3))
    faces = np.array(item.faces, dtype=np.int64).reshape(-1, 3)
    if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise UnreadableMeshError("The 3MF file has a triangle that refers to a vertex that does not exist.")
    return vertices, faces.astype(np.int32)


READERS = {"3mf": Reader(read_3mf, is_zip)}
