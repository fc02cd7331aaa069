"""What every layout has in common."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from model.formats import SOUGHT


@dataclass(frozen=True, slots=True)
class SourceFile:
    """One mesh file: where it is, and what shapes.csv will call it.

    ``name`` is unique and decides whether `fit` trains on the shape or validates with it: it never changes. ``split``
    is the data set's own (``train``, ``val``, ``test``), empty where it has none; ``licence`` likewise.
    """

    path: Path
    name: str
    source: str
    category: str
    licence: str = ""
    split: str = ""


def mesh_files(root: Path) -> Iterator[tuple[Path, tuple[str, ...]]]:
    """All files below ``root`` in a format the service reads, with the parts of their path below it."""
    for folder, _, files in os.walk(root):
        for file in files:
            path = Path(folder) / file
            if path.suffix.lower().lstrip(".") in SOUGHT:
                yield path, path.relative_to(root).parts


def path_name(root: Path, parts: tuple[str, ...]) -> str:
    """The name of a file where the layout gives it none: its path, from the root's own name on."""
    return "/".join((root.name, *parts))
