"""Planes that other programs found, read from a file and judged beside methods that run here.

For programs that cannot be run or shipped: a CSV file with the columns ``mesh`` (the name of the shape, as
`training.layouts.find_meshes` gives it), ``method``, ``nx``, ``ny``, ``nz``, ``offset`` (n·x + offset = 0 in the mesh
file's coordinates) and ``time_ms`` (of all planes of a mesh together); further columns are ignored.
"""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from model.types import FloatArray

_COLUMNS = ("mesh", "method", "nx", "ny", "nz", "offset", "time_ms")


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPlanes:
    """What one program found for one mesh: ``planes`` ``(k, 4)`` in the file's coordinates, and its milliseconds."""

    planes: FloatArray
    milliseconds: float


def read_recorded(file: Path) -> dict[str, dict[str, RecordedPlanes]]:
    """The planes of a file by mesh and method, in the order of the file.

    Raises:
        ValueError: a column is missing, or a number is none.
    """
    with file.open(newline="", encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    if not rows or not set(_COLUMNS) <= set(rows[0]):
        raise ValueError(f"{file} needs the columns {', '.join(_COLUMNS)}")
    planes: dict[str, dict[str, list[list[float]]]] = {}
    times: dict[tuple[str, str], float] = {}
    for row in rows:
        mesh, method = row["mesh"], row["method"]
        plane = [float(row[column]) for column in _COLUMNS[2:6]]
        planes.setdefault(mesh, {}).setdefault(method, []).append(plane)
        times[mesh, method] = float(row["time_ms"])
    return {
        mesh: {method: RecordedPlanes(_unit(np.array(found)), times[mesh, method]) for method, found in methods.items()}
        for mesh, methods in planes.items()
    }


def _unit(planes: FloatArray) -> FloatArray:
    """Rounded to a few digits in the file, normals are made unit again."""
    return planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
