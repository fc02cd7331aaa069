"""Folders of meshes in the layouts they are published in: recognised by their files.

One file a layout: `shapenet`, `modelnet`, `abc_dataset`, `thingi10k`, and `plain` for everything else. A layout says
whether a folder looks like it and lists its meshes; to add one, write such a file and name it in `_LAYOUTS`.
"""

import io
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from model.errors import UnreadableMeshError
from model.formats import read_mesh
from model.meshes.mesh import Mesh
from training.layouts import abc_dataset, modelnet, plain, shapenet, thingi10k
from training.layouts._files import SourceFile
from training.layouts._manifest import Manifest

__all__ = ["SourceFile", "draw_meshes", "find_meshes", "parse"]

_LAYOUTS = (shapenet, modelnet, abc_dataset, thingi10k, plain)
"""The first that recognises a folder lists it; `plain` recognises every one."""


def find_meshes(folders: Sequence[Path], *, split: str | None = None, manifest: Path | None = None) -> list[SourceFile]:
    """All mesh files below ``folders``, sorted by name.

    Args:
        folders: each in one of the layouts; in plain ones the first folder below the root is the category.
        split: take only what the layout, or a manifest, puts there: ``train``, ``val`` or ``test``.
        manifest: a CSV file with a column ``path`` and any of ``source``, ``category``, ``licence``, ``split``, which
            say more than the folders do. A ``manifest.csv`` in a folder is read without being named.

    Raises:
        ValueError: a folder does not exist, there is no mesh below any of them or none of the split, or a manifest has
            no column ``path`` or fits no file.
    """
    found: list[SourceFile] = []
    for root in folders:
        if not root.is_dir():
            raise ValueError(f"{root} is not a folder")
        layout = next(layout for layout in _LAYOUTS if layout.recognises(root))
        files = layout.meshes(root)
        own = root / "manifest.csv"
        for path in (own if own.is_file() else None, manifest):
            if path is not None:
                files = Manifest(path).applied(root, files)
        found += files
    if not found:
        raise ValueError("there is no mesh file below the folders given")
    if split is not None:
        found = [source for source in found if source.split == split]
        if not found:
            raise ValueError(f"no mesh below the given folders belongs to the split {split!r}")
    return sorted(found, key=lambda source: source.name)


def draw_meshes(folders: Sequence[Path], limit: int | None, rng: np.random.Generator) -> list[tuple[int, SourceFile]]:
    """The meshes below ``folders`` by name, at most ``limit`` of them drawn at random, each with its index among all.

    Raises:
        ValueError: there is none (`find_meshes`).
    """
    sources = list(enumerate(find_meshes(folders)))
    if limit is None or limit >= len(sources):
        return sources
    return [sources[row] for row in sorted(rng.permutation(len(sources))[:limit])]


def parse(data: bytes, filename: str) -> Mesh:
    """The mesh in a file: every format of the service, and Thingi10K's ``.npz`` with ``vertices`` and ``facets``.

    Raises:
        MeshError: the file cannot be read, or holds no usable mesh.
    """
    if not filename.lower().endswith(".npz"):
        return read_mesh(data, filename)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            vertices, faces = arrays["vertices"], arrays["facets"]
        if vertices.ndim != 2 or faces.ndim != 2 or (vertices.shape[1], faces.shape[1]) != (3, 3):
            raise ValueError("the shapes are wrong")
    except (ValueError, KeyError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise UnreadableMeshError("The file holds no vertices and facets of triangles.") from error
    return replace(Mesh.checked(vertices.astype(np.float64), faces.astype(np.int64)), source_format="npz")
