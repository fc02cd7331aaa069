"""Reading mesh files: one reader a format, chosen by the file's name and checked against its content."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import PurePath
from typing import TypeAlias

from model.errors import MeshError, MeshTooLargeError, UnreadableMeshError, UnsupportedFormatError
from model.formats._3mf import is_3mf, is_zip, read_3mf
from model.formats._common import MOST_NODES, MOST_UNPACKED_BYTES, Limits, RawMesh
from model.formats._common import Resources as Resources
from model.formats._common import no_resources as no_resources
from model.formats._foreign import foreign_content, next_step
from model.formats._gltf import read_glb, read_gltf
from model.formats._meshopt import warm_up_kernels as warm_up_kernels
from model.formats._obj import read_obj
from model.formats._off import is_off, read_off
from model.formats._ply import read_ply
from model.formats._stl import is_ascii_stl, is_binary_stl, read_stl
from model.formats._text import DECIMAL_COMMAS, has_decimal_commas
from model.formats._usable import resolution_warning, without_broken_faces
from model.meshes.mesh import Mesh

_Reader: TypeAlias = Callable[[bytes, Limits, Resources], RawMesh]


def _alone(read: Callable[[bytes, Limits], RawMesh]) -> _Reader:
    """The reader of a format that never refers to other files."""
    return lambda data, limits, resources: read(data, limits)


_READERS: dict[str, _Reader] = {
    "stl": _alone(read_stl),
    "obj": _alone(read_obj),
    "ply": _alone(read_ply),
    "off": _alone(read_off),
    "glb": read_glb,
    "gltf": read_gltf,
    "3mf": _alone(read_3mf),
}
_TEXTS = ("stl", "obj", "ply", "off")  # that may be
SUPPORTED_FORMATS: tuple[str, ...] = tuple(_READERS)
_OBJ_LINE = re.compile(rb"^[ \t]*(v|f)[ \t]+[-+.0-9]", re.MULTILINE)


def read_mesh(
    data: bytes,
    filename: str,
    *,
    max_vertices: int | None = None,
    max_faces: int | None = None,
    max_nodes: int = MOST_NODES,
    max_unpacked_bytes: int = MOST_UNPACKED_BYTES,
    resources: Resources = no_resources,
) -> Mesh:
    """The mesh a file holds, in the file's own coordinates.

    Scene transforms are applied and all bodies joined into one mesh, as a viewer of the format would show them.
    Vertices at the same place are not merged; polygons become triangles. A few broken faces are left out. Whatever was
    left out or guessed is told in ``warnings``. Files that the data refer to are asked for, never opened here.

    Args:
        data: the whole file.
        filename: its name; only the extension counts.
        max_vertices: the largest number of vertices accepted, or None for any.
        max_faces: the same for triangles.
        max_nodes: the largest number of nodes, objects and placements of a scene.
        max_unpacked_bytes: the most bytes that the parts of a 3MF archive unpack to.
        resources: gives the content of a file by the name that the data call it (``chair.bin``), or None.

    Raises:
        UnsupportedFormatError: there is no reader for the extension, or the content is another format than it says.
        UnreadableMeshError: the content is damaged, incomplete, or refers to other files for its geometry.
        EmptyMeshError: there are no faces.
        DegenerateMeshError: NaN or infinite coordinates or indices out of range in more than a few faces, no extent or
            no area.
        MeshTooLargeError: there is more of something than allowed.
        MemoryError: the process has less memory than the file asks for.
    """
    kind = PurePath(filename).suffix[1:].lower()
    if kind not in _READERS:
        known = ", ".join(name.upper() for name in SUPPORTED_FORMATS)
        raise UnsupportedFormatError(f"The file name does not end in a supported format: {known}.{next_step(kind)}")
    if not data:
        raise UnreadableMeshError("The file is empty.")
    content = _recognise(data, kind)
    if content != kind:
        if words := foreign_content(data):
            raise UnsupportedFormatError(f"The file is named .{kind} but is {words}")
        if content is not None:
            raise UnsupportedFormatError(
                f"The file is named .{kind} but contains {content.upper()}; rename it to .{content}."
            )
    limits = Limits(max_vertices, max_faces, max_nodes, max_unpacked_bytes)
    try:
        raw = _READERS[kind](data, limits, resources)
        limits.check(len(raw.vertices), len(raw.faces))
        raw = without_broken_faces(raw)
        mesh = Mesh.checked(
            raw.vertices, raw.faces, source_format=kind, units=raw.units, warnings=raw.warnings, colors=raw.colors
        )  # fmt: skip
    except MeshTooLargeError:
        raise
    except (MemoryError, ImportError):  # the process's fault
        raise
    except MeshError as error:
        if kind in _TEXTS and has_decimal_commas(data):
            raise UnreadableMeshError(DECIMAL_COMMAS) from error
        raise
    except Exception as error:  # whatever a damaged file provokes is the file's fault, not the caller's
        raise UnreadableMeshError(f"The file cannot be read as {kind.upper()}.") from error
    return replace(mesh, warnings=(*mesh.warnings, *resolution_warning(mesh)))


def content_format(data: bytes) -> str | None:
    """The format that the content of a file shows, or None."""
    return "stl" if is_binary_stl(data) and not foreign_content(data) else _recognise(data, "")


def _recognise(data: bytes, kind: str) -> str | None:
    """The format that the content shows, or None if it shows none for certain; `kind` wins where several would fit."""
    head = data[:1024]
    if kind == "stl" and is_binary_stl(data) and not is_zip(data) and not head.startswith((b"ply", b"glTF")):
        return "stl"  # its header is free text, which may look like anything
    if re.match(rb"ply[ \t]*[\r\n]", head):
        return "ply"
    if head.startswith(b"glTF"):
        return "glb"
    if is_zip(data):
        return "3mf" if is_3mf(data) else None
    if is_off(data):
        return "off"
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    if text.startswith(b"{") and b"\0" not in head:
        return "gltf"
    if is_ascii_stl(data) and not (kind == "obj" and _OBJ_LINE.search(data[: 1 << 16])):
        return "stl"
    if kind != "obj" and b"\0" not in head and _OBJ_LINE.search(data[: 1 << 16]):
        return "obj"
    return None
