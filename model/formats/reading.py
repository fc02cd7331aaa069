"""Reading a mesh file of any format."""

import functools
from dataclasses import replace
from importlib import import_module
from pathlib import PurePath
from typing import cast

from model.errors import MeshError, MeshTooLargeError, UnreadableMeshError, UnsupportedFormatError
from model.formats import ARCHIVE, FORMATS
from model.formats._archive import open_archive
from model.formats._common import MOST_NODES, MOST_UNPACKED_BYTES, Limits, Reader, Resources, no_resources
from model.formats._foreign import foreign_content, next_step
from model.formats._meshopt import warm_up_kernels as warm_up_kernels
from model.formats._text import DECIMAL_COMMAS, has_decimal_commas, narrow
from model.formats._usable import joined_points, resolution_warning, without_broken_faces
from model.meshes.mesh import Mesh


def read_mesh(
    data: bytes,
    filename: str,
    *,
    max_vertices: int | None = None,
    max_faces: int | None = None,
    max_nodes: int = MOST_NODES,
    max_unpacked_bytes: int = MOST_UNPACKED_BYTES,
    resources: Resources = no_resources,
    looks: bool = False,
) -> Mesh:
    """The mesh a file holds, in the file's own coordinates.

    Scene transforms are applied and all bodies joined into one mesh, as a viewer of the format would show them.
    Vertices at the same place are not merged; polygons become triangles. A few broken faces are left out. A point cloud
    is joined to a surface (`model.meshes.points`). Whatever was left out or guessed is told in ``warnings``. Files that
    the data refer to are asked for, never opened here. A zip archive that holds one mesh is read for that mesh.

    Args:
        data: the whole file.
        filename: its name; only the extension counts.
        max_vertices: the largest number of vertices accepted, or None for any.
        max_faces: the same for triangles.
        max_nodes: the largest number of nodes, objects and placements of a scene.
        max_unpacked_bytes: the most bytes that the parts of a 3MF or zip archive unpack to.
        looks: whether colours of materials and pictures are read too, for those who write the mesh again.
        resources: gives the content of a file by the name that the data call it (``chair.bin``), or None.

    Raises:
        UnsupportedFormatError: there is no reader for the extension, or the content is another format than it says.
        UnreadableMeshError: the content is damaged, incomplete, or refers to other files for its geometry.
        EmptyMeshError: there are no faces, nor enough points for a surface.
        DegenerateMeshError: NaN or infinite coordinates or indices out of range in more than a few faces, no extent or
            no area.
        MeshTooLargeError: there is more of something than allowed.
        MemoryError: the process has less memory than the file asks for.
    """
    extension = PurePath(filename).suffix[1:].lower()
    if extension == ARCHIVE and data:
        data, filename, resources = open_archive(data, max_unpacked_bytes)
        extension = PurePath(filename).suffix[1:].lower()
    if extension not in FORMATS:
        known = ", ".join(format.label for format in FORMATS.values())
        raise UnsupportedFormatError(
            f"The file name does not end in a supported format: {known}.{next_step(extension)}"
        )
    if not data:
        raise UnreadableMeshError("The file is empty.")
    if _readers()[extension].may_be_text:
        data = narrow(data)
    content = _recognize(data, extension)
    if content != extension:
        if words := foreign_content(data):
            raise UnsupportedFormatError(f"The file is named .{extension} but is {words}")
        if content is not None:
            raise UnsupportedFormatError(
                f"The file is named .{extension} but contains {FORMATS[content].label}; rename it to .{content}."
            )
    limits = Limits(max_vertices, max_faces, max_nodes, max_unpacked_bytes, looks)
    try:
        raw = _readers()[extension].read(data, limits, resources)
        limits.check(len(raw.vertices), len(raw.faces))
        is_cloud = FORMATS[extension].points and not len(raw.faces)
        raw = joined_points(raw) if is_cloud else without_broken_faces(raw)
        limits.check(faces=len(raw.faces))
        mesh = Mesh.checked(
            raw.vertices,
            raw.faces,
            source_format=extension,
            units=raw.units,
            warnings=raw.warnings,
            colors=raw.colors,
            kind="points" if is_cloud else "mesh",
            texture=raw.texture,
            painted=raw.painted,
        )
    except (MeshTooLargeError, MemoryError, ImportError):  # the last two are the process's fault
        raise
    except MeshError as error:
        if _readers()[extension].may_be_text and has_decimal_commas(data):
            raise UnreadableMeshError(DECIMAL_COMMAS) from error
        raise
    except Exception as error:  # whatever a damaged file provokes is the file's fault, not the caller's
        raise UnreadableMeshError(f"The file cannot be read as {FORMATS[extension].label}.") from error
    return replace(mesh, warnings=(*mesh.warnings, *resolution_warning(mesh)))


def content_format(data: bytes) -> str | None:
    """The format that the content of a file shows, or None."""
    return None if foreign_content(data) else _recognize(data, "")


@functools.cache
def _readers() -> dict[str, Reader]:
    """All readers, in the order of `FORMATS`. Loaded together: a sandboxed process can import nothing later on."""
    modules = {format.extension: import_module(f"model.formats.{format.module}") for format in FORMATS.values()}
    return {extension: cast(dict[str, Reader], module.READERS)[extension] for extension, module in modules.items()}


def _recognize(data: bytes, named: str) -> str | None:
    """The format that the content is certainly of, if any; that of the name where several would fit."""
    readers = _readers()
    return next((name for name in (named, *readers) if name and readers[name].recognize(data)), None)
