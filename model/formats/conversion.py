"""A checked `Mesh` from whatever a caller of the library holds: a path, arrays, an object of trimesh."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol, TypeAlias, runtime_checkable

from numpy.typing import ArrayLike

from model.formats import read_mesh
from model.meshes.mesh import Mesh


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


def as_mesh(value: MeshLike) -> Mesh:
    """A checked mesh from whatever a caller holds.

    Args:
        value: a ``Mesh``; an object with ``vertices`` and ``faces`` (``trimesh.Trimesh``); a ``trimesh.Scene``,
            taken in world coordinates; a pair (vertices, faces); or the path of a mesh file.

    Raises:
        MeshError: the mesh cannot be used; the subclass says why.
        OSError: the file cannot be opened.
        TypeError: the value is none of the above.
    """
    if isinstance(value, Mesh):
        return value
    if isinstance(value, str | os.PathLike):
        path = Path(value)
        return read_mesh(path.read_bytes(), path.name)
    if isinstance(value, HasScene) and not isinstance(value, HasTriangles):
        return as_mesh(value.to_mesh())
    if isinstance(value, HasTriangles):
        return Mesh.checked(value.vertices, value.faces)
    if isinstance(value, tuple | list) and len(value) == 2:
        return Mesh.checked(value[0], value[1])
    raise TypeError(f"cannot make a mesh out of a {type(value).__name__}")
