"""The symmetries that `training shapes` recorded for a file, in the form of the search's results."""

import json
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from model.geometry.frames import UnitFrame
from model.meshes.mesh import Mesh
from model.types import FloatArray
from training.oracle.groundtruth import find_symmetries
from training.oracle.truth import Truth, TruthAxis

_SAME = 1e-6
"""So far apart, of a scale, two unit frames may be that are one: files hold twelve digits."""


def truth_of(path: Path, mesh: Mesh, frame: UnitFrame, known: Truth | None) -> tuple[Truth, str | None]:
    """What `training shapes` wrote down, else what is ``known``, else what a search finds; and the group if written.

    What is known of a mesh in another unit frame is of another mesh, and is not taken.
    """
    written = written_truth(path, frame)
    if known is not None and not _same_frame(known, frame):
        known = None
    return written or (known or find_symmetries(mesh.vertices, mesh.faces), None)


def _same_frame(truth: Truth, frame: UnitFrame) -> bool:
    apart = float(np.linalg.norm(truth.center - frame.center))
    return max(apart, abs(truth.scale - frame.scale)) <= _SAME * frame.scale


def written_truth(path: Path, frame: UnitFrame) -> tuple[Truth, str] | None:
    """Truth and point group that `training shapes` wrote beside a file, in its unit frame; None if it did not.

    Of the planes through a continuous axis, which the file does not list, two are added as the search would.
    """
    entry = written_entry(path)
    if entry is None:
        return None
    planes = [frame.plane_to_unit(np.array(plane)) for plane in entry["planes"]]
    axes = [
        TruthAxis(np.array(axis["direction"]), frame.to_unit(np.array(axis["point"])), axis["order"], 0.0)
        for axis in entry["axes"]
    ]
    truth = listed_truth(frame, np.reshape(planes, (-1, 4)), np.zeros(len(planes)), axes)
    return truth, entry["point_group"]


def written_entry(path: Path) -> dict[str, Any] | None:
    """What `training shapes` wrote of a file, in the file's frame, as plain values; None if it wrote nothing."""
    file = path.parent / "ground_truth.json"
    return _written(file, file.stat().st_mtime_ns).get(path.name) if file.is_file() else None


@lru_cache(maxsize=4)
def _written(file: Path, changed: int) -> dict[str, Any]:
    """The contents of a file that was ``changed`` last at this time."""
    return json.loads(file.read_text(encoding="utf-8"))


def listed_truth(frame: UnitFrame, planes: FloatArray, errors: FloatArray, axes: list[TruthAxis]) -> Truth:
    """Ground truth from ``planes`` ``(k, 4)`` with ``errors`` ``(k,)`` that leave out those through a continuous axis.

    Two of them are added, as the search would, as exact as the axis is taken to be.
    """
    endless = [axis for axis in axes if axis.order is None]
    through = planes_through(endless[0]) if len(endless) == 1 else []
    return Truth(
        center=frame.center,
        scale=frame.scale,
        planes=np.concatenate([planes, np.reshape(through, (-1, 4))]),
        plane_errors=np.concatenate([errors, np.zeros(len(through))]),
        plane_continuous=np.array([len(endless) > 1] * len(planes) + [True] * len(through), dtype=np.bool_),
        axes=axes,
    )


def planes_through(axis: TruthAxis) -> list[FloatArray]:
    """The two perpendicular planes (n, d) that stand for all planes through a continuous axis in a list."""
    first: FloatArray = np.eye(3)[np.argmin(np.abs(axis.direction))]
    first = first - (first @ axis.direction) * axis.direction
    first /= np.linalg.norm(first)
    second = np.array(np.cross(axis.direction, first), dtype=np.float64)
    return [np.append(normal, -normal @ axis.point) for normal in (first, second)]
