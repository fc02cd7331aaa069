"""The point groups in their own frames: what each one holds, by its Schoenflies symbol.

In its own frame the principal axis of an axial group is z. Of a group with two-fold axes across (Dn, Dnh, Dnd) one is
x; of one with planes through the axis alone (Cnv) x is the normal of one. Cs is the mirror z = 0. Cubic groups have
their four-fold (T: two-fold) axes along x, y, z; icosahedral ones have two-fold axes there.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from model.geometry.operations import Operations, linear_parts
from model.search import closure
from model.types import BoolArray, FloatArray

CONTINUOUS = ("Cinfv", "Dinfh", "Kh")
"""The groups with a continuous axis, each within the next."""

ARBITRARY_ANGLES = np.array([1.474, 2.552, 0.539, 2.095, 1.366])
"""Radians. For every order up to 64 one of them is at least 0.33 of a step away from all multiples of the step (found
by random search; multiples of the golden angle come near those of 21 and 34)."""

_X, _Y, _Z = np.eye(3)
_GOLDEN = (1.0 + 5.0**0.5) / 2.0


@dataclass(frozen=True, slots=True, eq=False)
class PointGroup:
    """A point group in its own frame, fixed point at the origin.

    ``name``: Schoenflies symbol in ASCII. ``normals`` ``(p, 3)`` of its planes, ``directions`` ``(a, 3)`` of its axes
    with their ``orders`` ``(a,)``, 0 for a continuous one. Of a family without end some stand for all: two planes
    through the axis of Cinfv and Dinfh, three perpendicular planes and axes of Kh. ``generators``: operations that
    generate the group; for a continuous one a few that tell whether it holds. ``matrices`` ``(g, 3, 3)``: all members
    of a finite group, the identity first; empty for a continuous one.
    """

    name: str
    normals: FloatArray
    directions: FloatArray
    orders: tuple[int, ...]
    generators: Operations
    matrices: FloatArray

    @property
    def size(self) -> float:
        """The number of members; infinite for a continuous group."""
        return np.inf if self.name in CONTINUOUS else float(len(self.matrices))

    @property
    def principal_order(self) -> int:
        """The largest order of an axis; 1 without axes, 0 where one is continuous."""
        return 0 if self.name in CONTINUOUS else max(self.orders, default=1)


@lru_cache(maxsize=512)
def point_group(name: str) -> PointGroup:
    """The point group with a Schoenflies symbol in ASCII, such as ``D6h``, ``S8``, ``Th`` or ``Dinfh``.

    Raises:
        ValueError: there is no such symbol.
    """
    if name in CONTINUOUS:
        return _continuous(name)
    if name in ("T", "Td", "Th", "O", "Oh", "I", "Ih"):
        return _polyhedral(name)
    if name in ("C1", "Cs", "Ci"):
        generators = {"C1": [], "Cs": [(_Z, 0.0, True)], "Ci": [(_Z, np.pi, True)]}[name]
        normals = _Z[None] if name == "Cs" else np.zeros((0, 3))
        return _finite(name, normals, np.zeros((0, 3)), (), generators)
    match = re.fullmatch(r"([CDS])([1-9][0-9]*)([vhd]?)", name)
    if match is None:
        raise ValueError(f"there is no point group {name!r}")
    family, number, suffix = match[1], int(match[2]), match[3]
    if (family == "S" and (suffix or number % 2)) or family + suffix in ("Cd", "Dv") or (family != "S" and number < 2):
        raise ValueError(f"there is no point group {name!r}")
    return _axial(name, family + suffix, number // 2 if family == "S" else number)


def axial_name(order: int, *, through: bool, across: bool, half_turns: bool, rotoreflection: bool) -> str:
    """The symbol of an axial group from what it holds.

    Args:
        order: of the principal axis, 1 if there is none.
        through: planes through the axis.
        across: a plane across it.
        half_turns: two-fold axes across it.
        rotoreflection: the rotoreflection by half the axis' smallest rotation (by 180 degrees, the inversion, for 1).
    """
    if order == 1:
        return "C2v" if through and across else "Cs" if through or across else "Ci" if rotoreflection else "C1"
    if half_turns + through + across >= 2:
        if across:
            return f"D{order}h"
        return f"D{order}d"
    if half_turns:
        return f"D{order}d" if rotoreflection else f"D{order}"
    if through:
        return f"D{order}d" if rotoreflection else f"C{order}v"
    if across:
        return f"C{order}h"
    return f"S{2 * order}" if rotoreflection else f"C{order}"


def identify(matrices: FloatArray, same: float = closure.SAME) -> tuple[str, FloatArray] | None:
    """The symbol of a finite group ``(g, 3, 3)`` and its frame.

    The matrices need not be exact: those within ``same`` radians count as one. So some that are closed by chance may
    be no group at all.

    Returns:
        the Schoenflies symbol, and ``(3, 3)``, a proper rotation whose rows are the axes of the group's own frame;
        None if they are not the members of any point group.
    """
    found = closure.elements(matrices, same)
    normals, directions, orders = found
    name = closure.name(matrices, found, same)
    group = point_group(name)
    if len(normals) != len(group.normals) or sorted(orders) != sorted(group.orders) or len(matrices) != group.size:
        return None
    if name in ("C1", "Ci"):
        return name, np.eye(3)
    if name == "Cs":
        return name, frame_of(normals[0], normals[0])
    if name[0] in "TO" or name in ("I", "Ih"):
        return name, _polyhedral_frame(name, directions, np.array(orders))
    main = closure.principal(matrices, found)
    perpendicular = np.abs(directions @ main) < 0.5
    if name[0] == "D":
        across = directions[perpendicular & (np.array(orders) == 2)]
        return name, frame_of(main, across[0])
    if name.endswith("v"):
        through = normals[np.abs(normals @ main) < 0.5]
        return name, frame_of(main, through[0])
    return name, frame_of(main, main)


def contains(group: PointGroup, matrices: FloatArray, tolerance: float) -> BoolArray:
    """Which orthogonal matrices ``(k, 3, 3)``, in the group's own frame, are members up to an angle: ``(k,)``."""
    if group.name not in CONTINUOUS:
        traces = matrices.reshape(-1, 9) @ group.matrices.reshape(-1, 9).T
        return np.asarray((traces > 1.0 + 2.0 * np.cos(tolerance)).any(1))
    if group.name == "Kh":
        return np.ones(len(matrices), dtype=np.bool_)
    along = matrices[:, 2, 2]  # of the axis and its image
    proper = np.linalg.det(matrices) > 0
    keeps = np.abs(along) > np.cos(tolerance)
    if group.name == "Dinfh":
        return keeps
    return keeps & (along > 0) & (proper | keeps)


def _axial(name: str, family: str, n: int) -> PointGroup:
    turn, half = (_Z, 2.0 * np.pi / n, False), (_X, np.pi, False)
    across, through, roto = (_Z, 0.0, True), (_X, 0.0, True), (_Z, np.pi / n, True)
    steps = np.pi * np.arange(n) / n
    fan = _fan(steps)
    none = np.zeros((0, 3))
    main = _Z[None] if n > 1 else none
    orders = (n,) if n > 1 else ()
    if family == "C":
        return _finite(name, none, main, orders, [turn])
    if family == "S":
        return _finite(name, none, main, orders, [roto])
    if family == "Ch":
        return _finite(name, _Z[None], main, orders, [turn, across])
    if family == "Cv":
        return _finite(name, fan, main, orders, [turn, through])
    directions, orders = np.concatenate([main, fan]), (*orders, *(2,) * n)
    if family == "D":
        return _finite(name, none, directions, orders, [turn, half])
    if family == "Dh":
        normals = np.concatenate([_fan(steps + np.pi / 2.0), _Z[None]])
        return _finite(name, normals, directions, orders, [turn, half, across])
    return _finite(name, _fan(steps + np.pi / 2.0 + np.pi / (2.0 * n)), directions, orders, [roto, half])


def _fan(angles: FloatArray) -> FloatArray:
    return np.column_stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])


def _polyhedral(name: str) -> PointGroup:
    diagonal = np.ones(3) / np.sqrt(3.0)
    third = (diagonal, 2.0 * np.pi / 3.0, False)
    five = np.array([0.0, 1.0, _GOLDEN]) / np.hypot(1.0, _GOLDEN)
    inversion = (_Z, np.pi, True)
    generators = {
        "T": [(_Z, np.pi, False), third],
        "Td": [(_Z, np.pi / 2.0, True), third],
        "Th": [(_Z, 0.0, True), third],
        "O": [(_Z, np.pi / 2.0, False), third],
        "Oh": [(_Z, np.pi / 2.0, False), third, inversion],
        "I": [(five, 2.0 * np.pi / 5.0, False), third],
        "Ih": [(five, 2.0 * np.pi / 5.0, False), third, inversion],
    }[name]
    matrices = closure.closure(_operations(generators).matrices)
    assert matrices is not None  # these generators close
    normals, directions, orders = closure.elements(matrices)
    return PointGroup(name, normals, directions, orders, _operations(generators), matrices)


def _finite(
    name: str,
    normals: FloatArray,
    directions: FloatArray,
    orders: tuple[int, ...],
    generators: Sequence[tuple[FloatArray, float, bool]],
) -> PointGroup:
    """An axial group: the powers of its first generator times the products of the others, each of which is of order 2.

    Written out and not closed numerically, it is exact for every order.
    """
    matrices = np.eye(3)[None]
    operations = _operations(generators)
    if len(generators):
        first, *others = operations.matrices
        _, angle, improper = generators[0]
        count = 2 if angle == 0.0 else round(2.0 * np.pi / angle)
        powers = [linear_parts(generators[0][0][None], np.array([k * angle]), np.array([improper and k % 2 == 1]))[0]
                  for k in range(count)]  # fmt: skip
        matrices = np.stack(powers) if angle else np.stack([np.eye(3), first])
        for other in others:
            matrices = np.concatenate([matrices, matrices @ other])
    return PointGroup(name, normals, directions, orders, operations, matrices)


def _continuous(name: str) -> PointGroup:
    through = [(_X, 0.0, True), (_Y, 0.0, True)]
    turns = [(_Z, float(angle), False) for angle in ARBITRARY_ANGLES[:3]]
    none = np.zeros((0, 3, 3))
    if name == "Cinfv":
        return PointGroup(name, np.eye(3)[:2], _Z[None], (0,), _operations([*turns, *through]), none)
    across = (_Z, 0.0, True)
    turned_over = [(_Z, float(angle), True) for angle in ARBITRARY_ANGLES[3:]]
    if name == "Dinfh":
        return PointGroup(name, np.eye(3), _Z[None], (0,), _operations([*turns, *through, across, *turned_over]), none)
    around = [(axis, float(ARBITRARY_ANGLES[k]), False) for k, axis in enumerate(np.eye(3))]
    return PointGroup(name, np.eye(3), np.eye(3), (0, 0, 0), _operations([*around, *through, across]), none)


def _operations(parts: Sequence[tuple[FloatArray, float, bool]]) -> Operations:
    return Operations(
        np.array([part[0] for part in parts]).reshape(-1, 3),
        np.zeros((len(parts), 3)),
        np.array([part[1] for part in parts], dtype=np.float64),
        np.array([part[2] for part in parts], dtype=np.bool_),
    )


def frame_of(z: FloatArray, x: FloatArray) -> FloatArray:
    """A proper rotation with ``z`` as its last row and the part of ``x`` across it as its first; any, if none is."""
    x = x - (x @ z) * z
    length = float(np.sqrt(x @ x))
    if length < 1e-3:
        x = np.eye(3)[int(np.argmin(np.abs(z)))]
        x = x - (x @ z) * z
        length = float(np.sqrt(x @ x))
    a, b, c = (x / length).tolist()
    d, e, f = z.tolist()
    return np.array([[a, b, c], [e * c - f * b, f * a - d * c, d * b - e * a], [d, e, f]])


def _polyhedral_frame(name: str, directions: FloatArray, orders: FloatArray) -> FloatArray:
    candidates = directions[orders == (4 if name[0] == "O" else 2)]
    z = candidates[0]
    x = candidates[int(np.argmin(np.abs(candidates @ z)))]
    frame = frame_of(z, x)
    if name[0] != "I":
        return frame
    # Of the two ways to choose three perpendicular two-fold axes' order, one has the five-fold axes of the template.
    five = directions[orders == 5] @ frame.T
    template = point_group(name)
    known = template.directions[np.array(template.orders) == 5]
    if np.abs(five @ known.T).max(1).min() > 0.99:
        return frame
    return np.stack([frame[1], -frame[0], frame[2]])
