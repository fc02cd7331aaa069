"""A checked `Mesh` from whatever a caller of the library holds: a path, arrays, an object of trimesh."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any, Protocol, TypeAlias, cast, runtime_checkable
from urllib.parse import unquote

import numpy as np
from numpy.typing import ArrayLike

from model.formats._common import Resources
from model.formats.reading import read_mesh
from model.meshes.mesh import Mesh
from model.meshes.texture import Texture
from model.types import ByteArray


@runtime_checkable
class HasTriangles(Protocol):
    """Anything with vertices and triangles, such as a ``trimesh.Trimesh``."""

    @property
    def vertices(self) -> Any:
        """(v, 3) coordinates."""

    @property
    def faces(self) -> Any:
        """(f, 3) vertex indices."""


@runtime_checkable
class HasScene(Protocol):
    """Anything that becomes one triangle mesh in world coordinates, such as a ``trimesh.Scene``."""

    def to_mesh(self) -> Any:
        """One mesh with all transforms applied."""


MeshLike: TypeAlias = (
    Mesh | HasTriangles | HasScene | tuple[ArrayLike, ArrayLike] | Sequence[ArrayLike] | str | os.PathLike[str]
)


def as_mesh(value: MeshLike, *, looks: bool = False) -> Mesh:
    """A checked mesh from whatever a caller holds.

    Args:
        value: a ``Mesh``; an object with ``vertices`` and ``faces`` (``trimesh.Trimesh``), and perhaps ``colors``
            and ``texture`` as `Mesh` has them (what `app.halve` and its kin give); a ``trimesh.Scene``, taken in world
            coordinates; a pair (vertices, faces); or the path of a mesh file, which may refer to files
            in its folder and below.
        looks: of a file whether colours of materials and pictures are read too.

    Raises:
        MeshError: the mesh cannot be used; the subclass says why.
        OSError: the file cannot be opened.
        TypeError: the value is none of the above.
    """
    if isinstance(value, Mesh):
        return value
    if isinstance(value, str | os.PathLike):
        path = Path(value)
        return read_mesh(path.read_bytes(), path.name, resources=files_beside(path), looks=looks)
    if isinstance(value, HasScene) and not isinstance(value, HasTriangles):
        return as_mesh(value.to_mesh())
    if isinstance(value, HasTriangles):
        colors: Any = getattr(value, "colors", None)
        texture: Any = getattr(value, "texture", None)
        return Mesh.checked(
            value.vertices,
            value.faces,
            colors=cast(ByteArray, colors) if isinstance(colors, np.ndarray) else None,
            texture=texture if isinstance(texture, Texture) else None,
        )
    if isinstance(value, tuple | list) and len(value) == 2:
        return Mesh.checked(value[0], value[1])
    raise TypeError(f"cannot make a mesh out of a {type(value).__name__}")


def files_beside(path: str | os.PathLike[str]) -> Resources:
    """The files that a mesh file may refer to: those in its folder and in the folders in there, no others."""
    folder = Path(path).parent

    def read(name: str) -> bytes | None:
        beside = folder / unquote(name).replace("\\", "/")
        try:
            if beside.resolve().is_relative_to(folder.resolve()) and beside.is_file():
                return beside.read_bytes()
        except (OSError, ValueError):  # such as a name with a zero byte
            pass
        return None

    return read


def files_at_hand(files: Mapping[str, bytes]) -> Resources:
    """Files in memory, found by the last part of their name, in any case."""
    known = {_last(name): content for name, content in files.items()}
    return lambda name: known.get(_last(unquote(name)))


def _last(name: str) -> str:
    return PurePosixPath(name.replace("\\", "/")).name.casefold()
