"""The known symmetries of a shape, and the file format of `training groundtruth`."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from model.types import BoolArray, FloatArray

CLEAR_ERROR = 1e-6
"""An element is clear, symmetric up to modelling precision, when its symmetry error is below this."""
_DIGITS = 12


@dataclass(frozen=True, slots=True)
class TruthAxis:
    """A rotation axis: unit ``direction`` (3,), ``point`` (3,) on it, and the ``error`` (SDE) of its rotation.

    ``order`` is the largest n for which rotation by 2π/n holds, None where every angle does.
    """

    direction: FloatArray
    point: FloatArray
    order: int | None
    error: float


@dataclass(frozen=True, slots=True)
class Truth:
    """All planes and axes of one shape in its unit frame, each list sorted by error.

    Attributes:
        center, scale: the unit frame, ``unit = (input - center) / scale``; ``center`` is (3,), both in input units.
        planes: (p, 4) rows (n, d), ``n·x + d = 0``.
        plane_errors: (p,) exact SDE on samples that took no part in the search.
        plane_continuous: (p,) True for the one or two planes that stand for all planes through a continuous axis.
        axes: the axes.
    """

    center: FloatArray
    scale: float
    planes: FloatArray
    plane_errors: FloatArray
    plane_continuous: BoolArray
    axes: list[TruthAxis] = field(default_factory=list[TruthAxis])

    def clear_planes(self) -> FloatArray:
        """The rows of ``planes`` whose error is below ``CLEAR_ERROR``, (k, 4)."""
        return self.planes[self.plane_errors < CLEAR_ERROR]

    def clear_axes(self) -> list[TruthAxis]:
        """The axes whose error is below ``CLEAR_ERROR``."""
        return [axis for axis in self.axes if axis.error < CLEAR_ERROR]

    def to_entry(self) -> dict[str, Any]:
        """The shape's entry in the file: plain values, rounded to 12 decimals, errors to three digits."""
        return {
            "center": np.asarray(self.center, dtype=np.float64).tolist(),
            "scale": float(self.scale),
            "planes": [
                {"plane": _rounded(plane), "error": float(f"{error:.3g}")} | ({"continuous": True} if family else {})
                for plane, error, family in zip(self.planes, self.plane_errors, self.plane_continuous, strict=True)
            ],
            "axes": [
                {
                    "direction": _rounded(axis.direction),
                    "point": _rounded(axis.point),
                    "order": axis.order,
                    "error": float(f"{axis.error:.3g}"),
                }
                for axis in self.axes
            ],
        }

    @classmethod
    def from_entry(cls, entry: Mapping[str, Any]) -> "Truth":
        """The inverse of `to_entry`."""
        planes = entry["planes"]
        return cls(
            center=np.array(entry["center"], dtype=np.float64),
            scale=float(entry["scale"]),
            planes=np.array([plane["plane"] for plane in planes], dtype=np.float64).reshape(-1, 4),
            plane_errors=np.array([plane["error"] for plane in planes], dtype=np.float64),
            plane_continuous=np.array([plane.get("continuous", False) for plane in planes], dtype=np.bool_),
            axes=[
                TruthAxis(
                    np.array(axis["direction"], dtype=np.float64),
                    np.array(axis["point"], dtype=np.float64),
                    axis["order"],
                    float(axis["error"]),
                )
                for axis in entry["axes"]
            ],
        )


def load(path: Path) -> dict[str, Truth]:
    """The shapes of a ground-truth file by name (`SourceFile.name` of `training.layouts.find_meshes`)."""
    document = json.loads(path.read_text(encoding="utf-8"))
    return {name: Truth.from_entry(entry) for name, entry in document["shapes"].items()}


def named(known: Mapping[str, Truth], names: Sequence[str]) -> dict[str, Truth]:
    """What is ``known`` of the shapes of these names.

    A name begins with the folder that was given: where the file was made of a folder above that one, its names are
    longer. Such a one is taken where it alone ends as the name does.
    """
    longer: dict[str, list[str]] = {}
    for key in known:
        parts = key.split("/")
        for first in range(1, len(parts) - 1):
            longer.setdefault("/".join(parts[first:]), []).append(key)
    found = {name: [name] if name in known else longer.get(name, []) for name in names}
    return {name: known[keys[0]] for name, keys in found.items() if len(keys) == 1}


def save(path: Path, shapes: Mapping[str, Truth], settings: Mapping[str, Any], manifest_sha256: str) -> None:
    """Write a ground-truth file, one line a shape, so that versions of it can be compared.

    Args:
        path: the file to write.
        shapes: the shapes by name.
        settings: the settings of the search, plain values.
        manifest_sha256: digest of the names and contents of the mesh files.
    """
    head = f'{{"manifest_sha256": {json.dumps(manifest_sha256)},\n"settings": {json.dumps(dict(settings))},\n'
    lines = [
        f"{json.dumps(name)}: {json.dumps(truth.to_entry(), separators=(',', ':'))}"
        for name, truth in sorted(shapes.items())
    ]
    path.write_text(head + '"shapes": {\n' + ",\n".join(lines) + "\n}}\n", encoding="utf-8")


def _rounded(values: FloatArray) -> list[float]:
    # Adding zero turns -0.0 into 0.0.
    return [round(float(value), _DIGITS) + 0.0 for value in values]
