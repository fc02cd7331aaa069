"""Which larger point groups a group may be a part of, and how their frames lie in its own; what operations generate."""

from collections.abc import Iterator

import numpy as np

from model.geometry.operations import Operations
from model.search import closure
from model.search.point_groups import frame_of, identify
from model.types import FloatArray

_ALONG_DIAGONALS = {"C3v": "Td", "D3": "O", "D3d": "Oh"}
"""The cubic group that has one with a three-fold axis along the diagonals of its cube."""

_ALONG_FIVE_FOLD = {"C5v": "Ih", "D5": "I", "D5d": "Ih"}

EXACT_ANGLE, ROUGH_ANGLE = closure.SAME, float(np.deg2rad(3.0))
"""Operations of a group that holds precisely, or roughly, are one within so many radians."""

_ROUGH_ORDER = 12


def generated(operations: Operations, *, precise: bool) -> tuple[str, FloatArray] | None:
    """The group that operations generate, about a common point: its symbol and frame; None if there is none.

    ``precise`` operations may make axes of any order that is told from round, others of a few.
    """
    angle, largest = (EXACT_ANGLE, closure.LARGEST) if precise else (ROUGH_ANGLE, _ROUGH_ORDER)
    grown = closure.closure(operations.matrices, largest, angle, snap=not precise)
    return None if grown is None else identify(grown, angle)


def supergroups(name: str, order: int, frame: FloatArray) -> Iterator[tuple[str, FloatArray]]:
    """Larger groups that hold all a group holds, each with its own frame, the likeliest first.

    Args:
        name: the group's Schoenflies symbol.
        order: of its principal axis.
        frame: ``(3, 3)``, a proper rotation whose rows are the axes of the group's own frame.
    """
    if name == "C1":
        yield "Ci", frame
        return
    if name[0] in "TOI":
        larger = {"T": ("Td", "Th", "O"), "Td": ("Oh",), "Th": ("Oh",), "O": ("Oh",), "I": ("Ih",)}
        for symbol in larger.get(name, ()):
            yield symbol, frame
        return
    if order < 2:
        return
    if name[0] == "C" and name[-1].isdigit():
        yield f"C{order}h", frame
        yield f"S{2 * order}", frame
    if name.endswith("v"):
        yield f"D{order}h", frame_of(frame[2], frame[1])
        angle = np.pi / (2.0 * order)
        side = np.cross(frame[0], frame[2])
        yield f"D{order}d", frame_of(frame[2], np.cos(angle) * side + np.sin(angle) * np.cross(frame[2], side))
    if name == f"D{order}":
        yield f"D{order}h", frame
        for axes in (frame, frame[[1, 2, 0]], frame[[2, 0, 1]]) if order == 2 else (frame,):
            yield f"D{order}d", axes
    if name in ("D2", "D2h", "D2d", "D4", "D4h"):
        turned = np.stack([frame[0] + frame[1], frame[1] - frame[0], np.sqrt(2.0) * frame[2]]) / np.sqrt(2.0)
        for axes in (frame, turned) if name != "D2h" else (frame,):
            yield from ((symbol, axes) for symbol in ("Oh", "Td", "Th", "O", "T"))
    if order == 3 and name in _ALONG_DIAGONALS:
        for axes in _diagonal_frames(frame[2], frame[0]):
            yield _ALONG_DIAGONALS[name], axes
    if order == 5 and name in _ALONG_FIVE_FOLD:
        for side in (1.0, -1.0):
            yield _ALONG_FIVE_FOLD[name], _five_fold_frame(frame[2], side * frame[0])


def _diagonal_frames(diagonal: FloatArray, side: FloatArray) -> Iterator[FloatArray]:
    """The edges of the two cubes with this body diagonal and a face diagonal along ``side``."""
    across = np.cross(diagonal, side)
    for sign in (1.0, -1.0):
        along, third = diagonal / np.sqrt(3.0), sign * across / np.sqrt(6.0)
        first, second = along + side / np.sqrt(2.0) + third, along - side / np.sqrt(2.0) + third
        yield np.array([first, second, along - 2.0 * third])


def _five_fold_frame(five: FloatArray, half: FloatArray) -> FloatArray:
    """The two-fold frame of an icosahedron with a five-fold axis and a two-fold one across it."""
    golden = (1.0 + 5.0**0.5) / 2.0
    across, length = np.cross(five, half), np.hypot(1.0, golden)
    return np.stack([half, (five + golden * across) / length, (golden * five - across) / length])
