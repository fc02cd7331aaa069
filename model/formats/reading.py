"""Reading a mesh file of any format."""

import functools
from importlib import import_module
from pathlib import PurePath
from typing import cast

from model.errors import MeshError, UnreadableMeshError, UnsupportedFormatError
from model.formats import FORMATS
from model.formats._common import MOST_NODES, MOST_UNPACKED_BYTES, Limits, Reader
from model.meshes.mesh import Mesh


def read_mesh(
    data: bytes,
    filename: str,
    *,
    max_vertices: int | None = None,
    max_faces: int | None = None,
    max_nodes: int = MOST_NODES,
    max_unpacked_bytes: int = MOST_UNPACKED_BYTES,
) -> Mesh:
    """The mesh a file holds, in the file's own coordinates.

    Scene transforms are applied and all bodies joined into one mesh. Vertices at the same place are not merged, and
    polygons become triangles as fans around their first corner. Files that the data refer to are never opened.

    Args:
        data: the whole file.
        filename: its name; only the extension counts.
        max_vertices: the largest number of vertices accepted, or None for any.
        max_faces: the same for triangles.
        max_nodes: the largest number of nodes, objects and placements of a scene.
        max_unpacked_bytes: the most bytes that the parts of a 3MF archive unpack to.

    Raises:
        UnsupportedFormatError: there is no reader for the extension, or the content is another format than it says.
        UnreadableMeshError: the content is damaged, incomplete, or refers to other files for its geometry.
        EmptyMeshError: there are no faces.
        DegenerateMeshError: NaN or infinite coordinates, an index out of range, no extent or no area.
        MeshTooLargeError: there is more of something than allowed.
        MemoryError: the process has less memory than the file asks for.
    """
    extension = PurePath(filename).suffix[1:].lower()
    if extension not in FORMATS:
        known = ", ".join(format.label for format in FORMATS.values())
        raise UnsupportedFormatError(f"The file name does not end in a supported format: {known}.")
    if not data:
        raise UnreadableMeshError("The file is empty.")
    content = _recognize(data, extension)
    if content is not None and content != extension:
        raise UnsupportedFormatError(
            f"The file is named .{extension} but contains {FORMATS[content].label}; rename it to .{content}."
        )
    limits = Limits(max_vertices, max_faces, max_nodes, max_unpacked_bytes)
    try:
        raw = _readers()[extension].read(data, limits)
        limits.check(len(raw.vertices), len(raw.faces))
        return Mesh.checked(raw.vertices, raw.faces, source_format=extension, units=raw.units)
    except (MeshError, MemoryError, ImportError):  # the last two are the process's fault
        raise
    except Exception as error:  # whatever a damaged file provokes is the file's fault, not the caller's
        raise UnreadableMeshError(f"The file cannot be read as {FORMATS[extension].label}.") from error


@functools.cache
def _readers() -> dict[str, Reader]:
    """All readers, in the order of `FORMATS`. Loaded together: a sandboxed process can import nothing later on."""
    modules = {format.extension: import_module(f"model.formats.{format.module}") for format in FORMATS.values()}
    return {extension: cast(dict[str, Reader], module.READERS)[extension] for extension, module in modules.items()}


def _recognize(data: bytes, named: str) -> str | None:
    """The format that the content is certainly of, if any; that of the name where several would fit."""
    readers = _readers()
    return next((name for name in (named, *readers) if readers[name].recognize(data)), None)
