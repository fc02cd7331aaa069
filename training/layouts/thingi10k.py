"""Thingi10K: ``raw_meshes/ID.stl`` (also .obj, .ply, .off), or ``npz/ID.npz`` with ``vertices`` and ``facets``.

Both are recognised by the folder itself or one that holds it. Categories and licences are read where the files
``input_summary.csv`` and ``contextual_data.csv`` are found, in the folder or in ``metadata`` beside the meshes.
"""

import csv
from collections.abc import Iterator
from pathlib import Path

from model.formats import FORMATS
from training.layouts._files import SourceFile

_FOLDERS = ("raw_meshes", "npz")
_SUFFIXES = {"raw_meshes": {f".{name}" for name in FORMATS}, "npz": {".npz"}}


def recognises(root: Path) -> bool:
    """Whether there is a folder of the published name with numbered meshes in it."""
    return any(any(_meshes(folder)) for folder in _candidates(root))


def meshes(root: Path) -> list[SourceFile]:
    """One shape a file, named ``Thingi10K/ID`` in either variant; of a shape that is there in both, the original."""
    things = _things(root)
    found: dict[str, SourceFile] = {}
    for folder in _candidates(root):
        for path in sorted(_meshes(folder)):
            if path.stem not in found:
                category, licence = things.get(path.stem, ("", ""))
                found[path.stem] = SourceFile(path, f"Thingi10K/{path.stem}", "Thingi10K", category, licence)
    return list(found.values())


def _candidates(root: Path) -> list[Path]:
    folders = [root, *(root / name for name in _FOLDERS), *(root / "Thingi10K" / name for name in _FOLDERS)]
    return [folder for folder in folders if folder.name in _FOLDERS and folder.is_dir()]


def _meshes(folder: Path) -> Iterator[Path]:
    suffixes = _SUFFIXES[folder.name]
    return (path for path in folder.iterdir() if path.stem.isdigit() and path.suffix.lower() in suffixes)


def _things(root: Path) -> dict[str, tuple[str, str]]:
    """Category and licence of each file's thing, by the file's ID."""
    summary, context = _table(root, "input_summary.csv"), _table(root, "contextual_data.csv")
    things = {row["Thing ID"]: row for row in context}
    found: dict[str, tuple[str, str]] = {}
    for row in summary:
        thing = things.get(row["Thing ID"], {})
        found[row["ID"]] = (_known(thing.get("Category")), _known(row.get("License") or thing.get("License")))
    return found


def _known(value: str | None) -> str:
    return "" if value in (None, "None", "unknown") else value.strip()


def _table(root: Path, name: str) -> list[dict[str, str]]:
    for folder in (root, root / "metadata", root / "Thingi10K" / "metadata", root.parent, root.parent / "metadata"):
        if (folder / name).is_file():
            with (folder / name).open(newline="", encoding="utf-8", errors="replace") as lines:
                return list(csv.DictReader(lines))
    return []
