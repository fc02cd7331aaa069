"""Procedural shapes whose symmetries are known exactly, for tests, demos and training without data at hand.

>>> shape = generate("prism", np.random.default_rng(0), n=6)
>>> shape.point_group, len(shape.planes)
('D6h', 7)

Symmetry holds by construction: most shapes are built from rings, or by taking one irregular solid through
every element of a point group. Surfaces of revolution and the sphere are tessellated finely and listed with
the symmetry of the ideal surface.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from model.types import FloatArray, IntArray
from training.shapes.families import FAMILIES, Drawn
from training.shapes.furniture import FURNITURE
from training.shapes.point_groups import Elements, canonical_sign, group_elements
from training.shapes.solids import random_rotation

_FAMILIES: dict[str, Callable[..., Drawn]] = {**FAMILIES, **FURNITURE}
_CONTINUOUS = {
    "Cinfv": Elements(np.empty((0, 3)), np.array([[0.0, 0, 1]]), (0,)),
    "Dinfh": Elements(np.array([[0.0, 0, 1]]), np.array([[0.0, 0, 1]]), (0,)),
    "Kh": Elements(np.eye(3), np.eye(3), (0, 0, 0)),
}


class KnownAxis(NamedTuple):
    """Unit ``direction`` (3,), ``point`` (3,) on the axis; ``order`` None where every angle is a symmetry."""

    direction: FloatArray
    point: FloatArray
    order: int | None


@dataclass(frozen=True, eq=False)
class KnownShape:
    """A closed mesh, possibly of many interpenetrating bodies, with all its planes and axes in its own frame.

    Attributes:
        name: the family it comes from.
        vertices: (v, 3) float64.
        faces: (f, 3) int32, looking outwards.
        point_group: a Schoenflies symbol in ASCII.
        planes: (p, 4) rows (n, d), unit normal and offset with n·x + d = 0, first non-zero component of n
            positive. Of a family of planes through a continuous axis none is listed; the plane perpendicular
            to it is.
        axes: every proper axis with its largest order. Of the two-fold axes perpendicular to a continuous one
            none is listed. A sphere lists three perpendicular continuous axes and planes.
        segments: for a surface of revolution, how many rotations about its axis map the tessellation to itself.
    """

    name: str
    vertices: FloatArray
    faces: IntArray
    point_group: str
    planes: FloatArray
    axes: tuple[KnownAxis, ...]
    segments: int | None = None
    parameters: dict[str, Any] = field(default_factory=dict[str, Any])

    @property
    def continuous_axes(self) -> tuple[KnownAxis, ...]:
        """The axes for which every angle is a symmetry: each stands for all planes through it."""
        return tuple(axis for axis in self.axes if axis.order is None)


def families() -> tuple[str, ...]:
    """Return the names that ``generate`` knows."""
    return tuple(_FAMILIES)


def generate(family: str, rng: np.random.Generator, *, pose: bool = False, **parameters: Any) -> KnownShape:
    """Return a random member of a family.

    Args:
        family: one of ``families()``.
        rng: the source of everything that ``parameters`` leave open; the same state gives the same shape.
        pose: also draw a rotation, a translation and a scale.
        parameters: what the family lets the caller fix, such as ``n`` or ``group``; see ``shape_families``,
            ``shape_furniture``.

    Raises:
        ValueError: there is no such family, or a parameter does not suit it.
    """
    if family not in _FAMILIES:
        raise ValueError(f"there is no family {family!r}; known are {', '.join(families())}")
    drawn = _FAMILIES[family](rng, **parameters)
    elements = _CONTINUOUS.get(drawn.group) or group_elements(drawn.group)
    normals, directions = elements.planes @ drawn.rotation.T, elements.axes @ drawn.rotation.T
    planes = [[*canonical_sign(normal), 0.0] for normal in normals]
    shape = KnownShape(
        name=family,
        vertices=drawn.solid[0],
        faces=drawn.solid[1],
        point_group=drawn.group,
        planes=np.array(planes).reshape(-1, 4) + 0.0,
        axes=tuple(
            KnownAxis(canonical_sign(direction) + 0.0, np.zeros(3), order or None)
            for direction, order in zip(directions, elements.orders, strict=True)
        ),
        segments=drawn.segments,
        parameters=parameters,
    )
    if not pose:
        return shape
    scale = float(10.0 ** rng.uniform(-1.0, 1.0))
    return posed(shape, random_rotation(rng), scale * rng.normal(size=3), scale)


def random_shape(rng: np.random.Generator, *, pose: bool = False) -> KnownShape:
    """Return a shape of a family drawn uniformly, its parameters drawn by the family."""
    names = families()
    return generate(names[int(rng.integers(len(names)))], rng, pose=pose)


def posed(shape: KnownShape, rotation: FloatArray, translation: FloatArray, scale: float = 1.0) -> KnownShape:
    """Return the shape under x ↦ ``scale`` · ``rotation`` x + ``translation``, planes and axes moved along.

    Args:
        shape: what to move.
        rotation: (3, 3), proper: a mirror would turn the faces inside out.
        translation: (3,).
        scale: positive.

    Raises:
        ValueError: ``rotation`` is not a proper rotation, or ``scale`` is not positive.
    """
    proper = np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-9) and np.linalg.det(rotation) > 0
    if not proper or not scale > 0:
        raise ValueError("a pose is a proper rotation, a translation and a positive scale")
    planes: list[list[float]] = []
    for plane in shape.planes:
        normal = rotation @ plane[:3]
        sign = 1.0 if canonical_sign(normal) @ normal > 0 else -1.0
        planes.append([*(sign * normal), sign * (scale * plane[3] - normal @ translation)])
    axes = [
        KnownAxis(canonical_sign(rotation @ axis.direction), scale * rotation @ axis.point + translation, axis.order)
        for axis in shape.axes
    ]
    return KnownShape(
        name=shape.name,
        vertices=scale * shape.vertices @ rotation.T + translation,
        faces=shape.faces,
        point_group=shape.point_group,
        planes=np.array(planes).reshape(-1, 4),
        axes=tuple(axes),
        segments=shape.segments,
        parameters=shape.parameters,
    )


def write_shapes(
    directory: Path, count: int, seed: int = 0, *, only: Sequence[str] = (), pose: bool = True
) -> list[Path]:
    """Write ``count`` shapes as binary PLY files and their symmetries as ``ground_truth.json`` beside them.

    Args:
        directory: made if missing.
        count: families take turns, so that ``count`` ≥ ``len(families())`` shows each at least once.
        seed: the same seed writes the same files; shape i does not depend on ``count``.
        only: families to take; all by default.
        pose: also draw a rotation, a translation and a scale for each.

    Returns:
        The mesh files. The JSON maps each file's name to ``family``, ``point_group``, ``planes`` (rows n, d)
        and ``axes`` (``order`` null where continuous), all in the file's own coordinates.

    Raises:
        ValueError: ``only`` names a family that does not exist.
    """
    directory.mkdir(parents=True, exist_ok=True)
    names = tuple(only) or families()
    truth: dict[str, Any] = {}
    paths: list[Path] = []
    for index in range(count):
        shape = generate(names[index % len(names)], np.random.default_rng([seed, index]), pose=pose)
        path = directory / f"{index:05d}_{shape.name}_{shape.point_group}.ply"
        path.write_bytes(binary_ply(shape.vertices, shape.faces))
        paths.append(path)
        axes = [{"direction": a.direction.tolist(), "point": a.point.tolist(), "order": a.order} for a in shape.axes]
        truth[path.name] = {
            "family": shape.name,
            "point_group": shape.point_group,
            "planes": shape.planes.tolist(),
            "axes": axes,
        }
    (directory / "ground_truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    return paths


def binary_ply(vertices: FloatArray, faces: IntArray) -> bytes:
    """The bytes of a PLY file in double precision: in single, exact symmetry would end at 1e-7."""
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(vertices)}\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    records = np.empty(len(faces), dtype=[("count", "u1"), ("indices", "<i4", (3,))])
    records["count"], records["indices"] = 3, faces
    return header.encode("ascii") + vertices.astype("<f8").tobytes() + records.tobytes()
