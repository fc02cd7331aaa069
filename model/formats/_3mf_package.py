"""The parts of a 3MF archive: XML that is read within limits, and the objects in it."""

import posixpath
import zipfile
from array import array
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeAlias
from xml.parsers import expat

import numpy as np

from model.errors import MeshTooLargeError, UnreadableMeshError, UnsupportedFormatError
from model.formats._3mf_looks import Palette, number
from model.formats._3mf_slicers import BRUSHED, CURA, Roles, SlicerReader
from model.formats._common import Limits
from model.meshes.texture import MOST_PICTURES, Picture, picture
from model.types import FloatArray

_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/"
_PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/"
# Extensions that a file may require: they do not change where the triangles are.
_HARMLESS = tuple(
    f"http://schemas.{owner}/3dmanufacturing/{name}/"
    for owner, name in (
        ("microsoft.com", "core"), ("microsoft.com", "production"), ("microsoft.com", "material"),
        ("microsoft.com", "slice"), ("microsoft.com", "trianglesets"), ("3mf.io", "trianglesets"),
    )
)  # fmt: skip
_OTHER_SHAPES = ("beamlattice", "booleanshape", "displacementmesh", "levelset", "implicitfunction")
_RELATIONS = "_rels/.rels"
_DEFAULT_MODEL = "3D/3dmodel.model"
_DEEPEST = 100  # elements within elements; the format needs ten
_CHUNK = 1 << 18
_LONGEST_ELEMENT = 1 << 22
_UNITS = ("micron", "millimeter", "centimeter", "inch", "foot", "meter")

Key: TypeAlias = tuple[str, str]
"""Part of the archive and object id."""


@dataclass(frozen=True, slots=True)
class Reference:
    """An object placed in another one, or in the build."""

    target: Key
    matrix: FloatArray  # (4, 3): positions are row vectors, (x, y, z, 1) @ matrix


@dataclass(slots=True)
class Object:
    """A mesh, or objects placed together, or both."""

    kind: str
    vertices: "array[float]" = field(default_factory=lambda: array("d"))
    faces: "array[int]" = field(default_factory=lambda: array("q"))
    components: list[Reference] = field(default_factory=list[Reference])
    settings: dict[str, str] = field(default_factory=dict[str, str])  # of Cura
    # Group of colours and the entries of three corners, -1 for none: of every triangle if wanted, and of the object.
    paints: "array[int]" = field(default_factory=lambda: array("q"))
    paint: tuple[int, int] = (-1, -1)


class Package:
    """The parts of an archive and what was read from them."""

    def __init__(self, archive: zipfile.ZipFile, limits: Limits) -> None:
        self._archive = archive
        self._limits = limits
        self._sizes = {info.filename.lower(): info for info in archive.infolist()}
        self._budget = limits.max_unpacked_bytes
        self._nodes = 0
        self._read: set[str] = set()
        self.objects: dict[Key, Object] = {}
        self.build: list[Reference] = []
        self.units = "millimeter"
        self.roles = Roles()
        self.palettes: dict[str, Palette] = {}
        self.painted = False
        self.brushed = False
        self.pictures: list[Picture] = []
        self.lost_pictures = 0
        self.has_other_shapes = False
        self.start = self._find_start()

    def read_part(self, part: str) -> None:
        """Read the objects of one part, and the build if it is the first."""
        self._read.add(part)
        reader = _PartReader(self, part, self._limits)
        self._parse(part, reader.begin, reader.end, reader.text)

    def read_slicer_settings(self) -> None:
        """What slicers keep beside the model: which triangles and components are no part of the shape."""
        for part in self._sizes:
            if part.startswith("metadata/") and part.endswith(".config") and "model" in part:
                reader = SlicerReader(self.roles, self.count_node)
                self._parse(part, reader.begin, _nothing)

    def read_pictures(self) -> None:
        """The pictures that the parts refer to, each once, as far as they are there."""
        known: dict[str, int] = {}
        for part, palette in self.palettes.items():
            for each, path in palette.textures.items():
                name = _part_name(path, part)
                if name not in known:
                    found = picture(self._content(name)) if len(self.pictures) < MOST_PICTURES else None
                    known[name] = -1 if found is None else len(self.pictures)
                    self.lost_pictures += found is None
                    self.pictures += [] if found is None else [found]
                palette.numbers[each] = known[name]

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

    def _parse(
        self,
        part: str,
        begin: Callable[[str, dict[str, str]], None],
        end: Callable[[str], None],
        text: Callable[[str], None] | None = None,
    ) -> None:
        info = self._sizes.get(part.lower())
        if info is None:
            raise UnreadableMeshError("The 3MF file lacks a part that it refers to.")
        self._require_plain(info)
        parser = expat.ParserCreate(namespace_separator=" ")
        depth, fed = 0, 0
        spaces: dict[str | None, str] = {}

        def opened(name: str, attributes: dict[str, str]) -> None:
            nonlocal depth
            depth += 1
            if depth > _DEEPEST:
                raise UnreadableMeshError("The 3MF file nests its elements too deeply.")
            _require_known(attributes, spaces)
            begin(name, attributes)

        def closed(name: str) -> None:
            nonlocal depth
            depth -= 1
            end(name)

        parser.StartElementHandler = opened
        parser.EndElementHandler = closed
        parser.StartDoctypeDeclHandler = _refuse_doctype
        parser.CharacterDataHandler = text
        parser.StartNamespaceDeclHandler = spaces.__setitem__
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

    def _content(self, part: str) -> bytes | None:
        """A part that is no XML, within what is left to unpack; None where it is not there."""
        info = self._sizes.get(part.lower())
        if info is None:
            return None
        self._require_plain(info)
        with self._archive.open(info) as stream:
            content = stream.read(self._budget + 1)
        self._budget -= len(content)
        if self._budget < 0:
            raise self._too_large()
        return content

    def _require_plain(self, info: zipfile.ZipInfo) -> None:
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise UnreadableMeshError("The 3MF file is compressed in a way that 3MF does not allow.")
        if info.file_size > self._budget:
            raise self._too_large()


def _nothing(_: str) -> None:
    return


def _require_known(attributes: dict[str, str], spaces: dict[str | None, str]) -> None:
    """Refuse a part that requires an extension that is not known."""
    for prefix in attributes.get("requiredextensions", "").split():
        if not spaces.get(prefix, "").startswith(_HARMLESS):
            raise UnsupportedFormatError(
                "The 3MF file requires an extension that is not supported, such as beam lattices, boolean operations "
                "or encryption; export it as plain triangles."
            )


def _refuse_doctype(*_: object) -> None:
    raise UnreadableMeshError("The 3MF file has a document type declaration, which 3MF does not allow.")


class _PartReader:
    """Collects objects from the events of one XML part."""

    def __init__(self, package: Package, part: str, limits: Limits) -> None:
        self._package = package
        self._part = part
        self._limits = limits
        self._object: Object | None = None
        self._setting = ""
        self._palette = package.palettes.setdefault(part, Palette(limits.looks, self._check_looks))

    def begin(self, name: str, attributes: dict[str, str]) -> None:
        """An element starts."""
        namespace, _, local = name.rpartition(" ")
        item = self._object
        if local in _OTHER_SHAPES:
            self._package.has_other_shapes = True
        if item is not None and (local == "metadata" or (local == "setting" and namespace.startswith(CURA))):
            names = [value for key, value in attributes.items() if key.rpartition(" ")[2] in ("name", "key")]
            self._setting = names[0].rpartition(":")[2] if names else ""
            return
        self._palette.begin(local, attributes)
        if namespace and not namespace.startswith(_CORE):
            return
        if local == "vertex" and item is not None:
            item.vertices.extend((float(attributes["x"]), float(attributes["y"]), float(attributes["z"])))
        elif local == "triangle" and item is not None:
            item.faces.extend((int(attributes["v1"]), int(attributes["v2"]), int(attributes["v3"])))
            self._paint(item, attributes)
        elif local == "component" and item is not None:
            item.components.append(self._reference(attributes))
        elif local == "object":
            self._package.count_node()
            paint = number(attributes.get("pid")), number(attributes.get("pindex"))
            self._object = Object(attributes.get("type", "model"), paint=paint)
            self._package.painted = self._package.painted or paint[0] >= 0
            self._package.objects[self._part, attributes["id"]] = self._object
        elif local == "item" and self._part == self._package.start:
            self._package.build.append(self._reference(attributes))
        elif local == "model" and self._part == self._package.start:
            units = attributes.get("unit", "millimeter")
            self._package.units = units if units in _UNITS else "millimeter"

    def _check_looks(self, count: int) -> None:
        """Colours and places in pictures may be as many as vertices."""
        self._limits.check(vertices=count)

    def _paint(self, item: Object, attributes: dict[str, str]) -> None:
        """Note which colours a triangle has, or that it has some."""
        if len(attributes) > 3 and not self._package.brushed:
            self._package.brushed = any(name.rpartition(" ")[2] in BRUSHED for name in attributes)
        if not self._limits.looks:
            self._package.painted = self._package.painted or "p1" in attributes
            return
        group, entry = item.paint
        if "p1" in attributes:
            group = number(attributes["pid"]) if "pid" in attributes else group
            entry = number(attributes["p1"])
        item.paints.extend((group, entry, number(attributes.get("p2")), number(attributes.get("p3"))))

    def text(self, text: str) -> None:
        """Characters between the tags."""
        if self._setting and self._object is not None:
            self._object.settings[self._setting] = (self._object.settings.get(self._setting, "") + text)[:20]

    def end(self, name: str) -> None:
        """An element ends."""
        self._setting = ""
        local = name.rpartition(" ")[2]
        if self._object is not None and local in ("vertices", "triangles", "object"):
            self._limits.check(len(self._object.vertices) // 3, len(self._object.faces) // 3)
        if local == "object":
            self._object = None

    def _reference(self, attributes: dict[str, str]) -> Reference:
        self._package.count_node()
        paths = [value for name, value in attributes.items() if name.startswith(_PRODUCTION) and name.endswith(" path")]
        part = _part_name(paths[0], self._part) if paths else self._part
        matrix = np.eye(4)[:, :3].copy()
        if "transform" in attributes:
            matrix = np.array(attributes["transform"].split(), dtype=np.float64).reshape(4, 3)
        return Reference((part, attributes["objectid"]), matrix)


def _part_name(target: str, source: str) -> str:
    """Name of a part inside the archive."""
    return posixpath.normpath(posixpath.join("/", posixpath.dirname(source), target)).lstrip("/")
