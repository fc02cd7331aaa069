"""Furniture with known symmetries: chairs, tables and the like as unions of boxes. z is up, the front is -y."""

import numpy as np

from training.shapes.families import Drawn, Rng
from training.shapes.point_groups import group_matrices
from training.shapes.solids import Solid, box, merge, orbit, revolve

_Y = np.roll(np.eye(3), 2, axis=0)  # rotates z to y, y to x, x to z


def table(rng: Rng, square: bool | None = None) -> Drawn:
    """C2v, or C4v when ``square``: a top on four legs, sometimes with a lower board."""
    square = bool(rng.random() < 0.3) if square is None else square
    depth, height, leg = (
        1.0 if square else float(rng.uniform(0.45, 0.75)),
        float(rng.uniform(0.5, 1.0)),
        float(rng.uniform(0.05, 0.1)),
    )
    bodies = [
        box((1.0, depth, 0.06), (0.0, 0.0, height)),
        *_legs(1.0 - 2 * leg, depth - 2 * leg, height, leg),
    ]
    if rng.random() < 0.4:
        bodies.append(box((1.0 - 2 * leg, depth - 2 * leg, 0.03), (0.0, 0.0, float(rng.uniform(0.15, 0.3)) * height)))
    return Drawn(merge(*bodies), "C4v" if square else "C2v")


def stool(rng: Rng, n: int | None = None) -> Drawn:
    """Cnv: a round seat on ``n`` legs."""
    n = int(rng.integers(3, 7)) if n is None else n
    height, leg = float(rng.uniform(0.8, 1.4)), float(rng.uniform(0.1, 0.18))
    seat = revolve(np.array([[0.75, height], [0.75, height + 0.12]]), 24 * n)
    legs = orbit(box((leg, leg, height), (0.6, 0.0, 0.5 * height)), group_matrices(f"C{n}"))
    return Drawn(merge(seat, legs), f"C{n}v")


def chair(rng: Rng) -> Drawn:
    """Cs: seat, four legs, a back, sometimes arms."""
    width, depth, seat, leg = (
        float(rng.uniform(0.8, 1.1)),
        float(rng.uniform(0.75, 1.0)),
        float(rng.uniform(0.7, 1.0)),
        0.07,
    )
    back = float(rng.uniform(0.5, 0.9))
    bodies = [
        box((width, depth, 0.08), (0.0, 0.0, seat)),
        box((width, 0.07, back), (0.0, 0.5 * depth, seat + 0.5 * back)),
        *_legs(width - leg, depth - leg, seat, leg),
    ]
    if rng.random() < 0.4:
        bodies += [box((0.07, 0.8 * depth, 0.06), (side * width / 2.0, 0.05, seat + 0.3)) for side in (-1, 1)]
        bodies += [box((0.06, 0.06, 0.3), (side * width / 2.0, -0.3 * depth, seat + 0.15)) for side in (-1, 1)]
    return Drawn(merge(*bodies), "Cs")


def shelf(rng: Rng, group: str | None = None) -> Drawn:
    """D2h open, C2v with a back, Cs with a back and uneven boards: a bookcase."""
    group = str(rng.choice(["D2h", "C2v", "Cs"])) if group is None else group
    width, depth, height = (
        float(rng.uniform(0.7, 0.9)),
        float(rng.uniform(0.25, 0.4)),
        float(rng.uniform(1.3, 2.0)),
    )
    boards = np.linspace(-0.5, 0.5, int(rng.integers(3, 7))) * height
    if group == "Cs":
        boards = np.append(boards[[0, -1]], [-0.31 * height, float(rng.uniform(0.05, 0.2)) * height])
    bodies = [box((width, depth, 0.04), (0.0, 0.0, float(z))) for z in boards]
    bodies += [box((0.04, depth, height + 0.04), (side * width / 2.0, 0.0, 0.0)) for side in (-1, 1)]
    if group != "D2h":
        bodies.append(box((width, 0.03, height), (0.0, 0.5 * depth, 0.0)))
    return Drawn(merge(*bodies), group, rotation=_Y if group == "C2v" else np.eye(3))


def desk(rng: Rng) -> Drawn:
    """Cs: a top on a wide chest at one side and a panel at the other."""
    depth, height, chest = (
        float(rng.uniform(0.5, 0.7)),
        float(rng.uniform(0.55, 0.75)),
        float(rng.uniform(0.25, 0.4)),
    )
    bodies = [
        box((1.4, depth, 0.05), (0.0, 0.0, height)),
        box((chest, 0.9 * depth, height), (0.65 - 0.5 * chest, 0.0, 0.5 * height)),
        box((0.05, 0.9 * depth, height), (-0.62, 0.0, 0.5 * height)),
    ]
    return Drawn(merge(*bodies), "Cs", rotation=_Y @ _Y)


def _legs(width: float, depth: float, height: float, leg: float) -> list[Solid]:
    return [box((leg, leg, height), (x * width / 2.0, y * depth / 2.0, height / 2.0)) for x in (-1, 1) for y in (-1, 1)]


FURNITURE = {"table": table, "stool": stool, "chair": chair, "shelf": shelf, "desk": desk}
