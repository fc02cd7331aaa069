"""A manifest: a CSV file with sources, categories, licences and splits of mesh files."""

import csv
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from training.layouts._files import SourceFile

_COLUMNS = {"source": "source", "category": "category", "licence": "licence", "license": "licence", "split": "split"}
"""Columns that are understood, and the field each one fills; others are passed over."""


class Manifest:
    """The rows of a manifest by ``path``, which is relative to the root, or begins with the root's own name.

    Raises:
        ValueError: there is no column ``path``.
    """

    def __init__(self, path: Path) -> None:
        with path.open(newline="", encoding="utf-8-sig") as lines:
            reader = csv.DictReader(lines)
            if "path" not in (reader.fieldnames or ()):
                raise ValueError(f"{path} has no column path")
            self._rows = {
                row["path"].replace("\\", "/"): {
                    field: value for column, field in _COLUMNS.items() if (value := (row.get(column) or "").strip())
                }
                for row in reader
            }
        self._path = path

    def applied(self, root: Path, files: Sequence[SourceFile]) -> list[SourceFile]:
        """The files with what their rows say; files without a row stay as they are.

        Raises:
            ValueError: no row fits any file.
        """
        described: list[SourceFile] = []
        fitting = 0
        for source in files:
            inside = source.path.relative_to(root).as_posix()
            row = self._rows.get(inside) or self._rows.get(f"{root.name}/{inside}")
            fitting += row is not None
            described.append(replace(source, **row) if row else source)
        if files and not fitting:
            raise ValueError(f"no path in {self._path} is that of a mesh file below {root}")
        return described
