"""Mesh files and point clouds: one record a format, one reader a format.

The reader is chosen by the file's name and checked against its content.

All lists of formats (in the service, the command line, the viewer, in error messages) come from `FORMATS`. It is light:
the readers, with compiled kernels behind them, are loaded when the first file is read.
"""

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from model.formats.reading import read_mesh

__all__ = ["ARCHIVE", "FORMATS", "SOUGHT", "MeshFormat", "format_list", "read_mesh"]


@dataclass(frozen=True, slots=True)
class MeshFormat:
    """A mesh file format.

    Attributes:
        extension: of file names, lower case, without the dot; also the mesh's ``source_format``.
        label: what its users call it.
        module: the module of this package whose ``READERS`` has its reader.
        up: the coordinate axis that by convention points upwards.
        note: a restriction, as it follows the label in a list.
        points: whether a file without faces is a point cloud.
        sought: whether files of that name in a folder are taken for shapes; tables and arrays may be anything.
    """

    extension: str
    label: str
    module: str
    up: Literal["y", "z"]
    note: str = ""
    points: bool = False
    sought: bool = True


FORMATS: dict[str, MeshFormat] = {
    format.extension: format
    for format in (
        MeshFormat("stl", "STL", "_stl", up="z"),
        MeshFormat("obj", "OBJ", "_obj", up="y", points=True),
        MeshFormat("ply", "PLY", "_ply", up="y", points=True),
        MeshFormat("off", "OFF", "_off", up="y", points=True),
        MeshFormat("glb", "GLB", "_gltf", up="y"),
        MeshFormat("gltf", "glTF", "_gltf", up="y", note="with its .bin"),
        MeshFormat("3mf", "3MF", "_3mf", up="z"),
        MeshFormat("xyz", "XYZ", "_xyz", up="z", points=True),
        MeshFormat("pts", "PTS", "_xyz", up="z", points=True),
        MeshFormat("pcd", "PCD", "_pcd", up="z", points=True),
        MeshFormat("las", "LAS", "_arrays", up="z", points=True),
        MeshFormat("npy", "NPY", "_arrays", up="z", points=True, sought=False),
        MeshFormat("npz", "NPZ", "_arrays", up="z", points=True, sought=False),
        MeshFormat("csv", "CSV", "_xyz", up="z", points=True, sought=False),
    )
}
"""The formats by extension, in the order they are listed and, where a file is misnamed, tried."""


SOUGHT = frozenset(format.extension for format in FORMATS.values() if format.sought)
"""What is looked for in folders."""


ARCHIVE = "zip"
"""The extension of archives that are read for the one mesh that is in them."""


def format_list() -> str:
    """The formats as a sentence lists them."""
    return ", ".join(f"{format.label} {format.note}".strip() for format in FORMATS.values())


def __getattr__(name: str) -> Any:
    if name == "read_mesh":
        return import_module("model.formats.reading").read_mesh
    raise AttributeError(f"module 'model.formats' has no attribute {name!r}")
