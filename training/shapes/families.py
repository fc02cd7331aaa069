"""The families of procedural shapes: each function draws one solid and names its point group.

Proportions stay clear of the values at which a shape gains symmetry (a box of equal edges, an antiprism that
is an octahedron), and of those where a false symmetry would be hard to tell from a true one.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from model.types import FloatArray
from training.shapes.point_groups import group_matrices
from training.shapes.solids import (
    Solid,
    box,
    geodesic_sphere,
    irregular,
    loft,
    merge,
    moved,
    orbit,
    regular_solid,
    revolve,
    ring,
)

Rng = np.random.Generator


class Drawn(NamedTuple):
    """A solid and its group, whose conventional frame ``rotation`` (3, 3) takes to the solid's."""

    solid: Solid
    group: str
    rotation: FloatArray = np.eye(3)
    segments: int | None = None


def orbit_shape(rng: Rng, group: str | None = None) -> Drawn:
    """Any finite group: an irregular solid on a spoke, and all its images. ``group`` is drawn by default."""
    if group is None:
        n = int(rng.integers(2, 9))
        cyclic = [f"C{n}", f"C{n}v", f"C{n}h", f"D{n}", f"D{n}h", f"D{n}d", f"S{2 * n}"]
        group = str(rng.choice([*cyclic, "T", "Th", "Td", "O", "Oh", "I", "Ih"]))
    matrices = group_matrices(group)
    solid = irregular(rng)
    if len(matrices) == 1:
        return Drawn(solid, group)
    # Of some directions, the one whose images keep best apart: overlapping images would look symmetric.
    directions = rng.normal(size=(32, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    images = np.einsum("gij,nj->ngi", matrices[1:], directions)
    gaps = np.linalg.norm(images - directions[:, None], axis=2).min(axis=1)
    best = int(np.argmax(gaps))
    centre, size = directions[best], 0.6 * float(min(gaps[best], 1.2))
    spoke = loft([ring(3, 0.0, radius=0.1 * size), ring(3, 1.0, radius=0.2 * size)], bent=False)
    side = np.cross(centre, np.roll(centre, 1))
    side /= np.linalg.norm(side)
    frame = np.stack([side, np.cross(centre, side), centre], axis=1)
    patch = merge(moved(solid, size * np.eye(3), centre), moved(spoke, frame))
    return Drawn(orbit(patch, matrices), group)


def none(rng: Rng) -> Drawn:
    """C1."""
    return orbit_shape(rng, "C1")


def mirror(rng: Rng) -> Drawn:
    """Cs: two irregular solids face each other."""
    return orbit_shape(rng, "Cs")


def inversion(rng: Rng) -> Drawn:
    """Ci: neither a plane nor an axis, yet not asymmetric."""
    return orbit_shape(rng, "Ci")


def improper(rng: Rng, n: int | None = None) -> Drawn:
    """S2n: an axis of order ``n`` and no plane."""
    return orbit_shape(rng, f"S{2 * _corners(rng, n, 2, 6)}")


def cyclic(rng: Rng, n: int | None = None) -> Drawn:
    """Cn: a twisted pyramid frustum with ``n`` tips, or a propeller of irregular blades."""
    n = _corners(rng, n, 2, 12)
    if rng.random() < 0.5:
        return orbit_shape(rng, f"C{n}")
    return Drawn(_twisted(rng, n, taper=float(rng.uniform(0.35, 0.6))), f"C{n}")


def dihedral(rng: Rng, n: int | None = None) -> Drawn:
    """Dn: a twisted star prism with ``n`` tips."""
    n = _corners(rng, n, 2, 12)
    return Drawn(_twisted(rng, n, taper=1.0), f"D{n}")


def pyramid(rng: Rng, n: int | None = None) -> Drawn:
    """Cnv: a pyramid over an n-gon or a star; over a rhombus for ``n`` = 2."""
    n = _corners(rng, n, 2, 12)
    height = float(rng.uniform(0.5, 1.1) if rng.random() < 0.5 else rng.uniform(1.8, 2.6))
    return Drawn(loft([ring(n, 0.0, inner=_notch(rng, n))], ends=(0.0, height)), f"C{n}v")


def gear(rng: Rng, n: int | None = None) -> Drawn:
    """Cnh: a flat saw blade with ``n`` teeth."""
    n = _corners(rng, n, 2, 12)
    height, inner = float(rng.uniform(0.2, 0.6)), float(rng.uniform(0.45, 0.6))
    skew = float(rng.uniform(0.25, 0.4))
    return Drawn(loft([ring(n, z, inner=inner, skew=skew) for z in (-height, height)], bent=False), f"C{n}h")


def prism(rng: Rng, n: int | None = None) -> Drawn:
    """Dnh: a right prism over a regular n-gon (a rhombus for ``n`` = 2); nearly round from ``n`` = 16 on."""
    n = _corners(rng, n, 2, 12)
    inner = _notch(rng, n) if n == 2 else None
    return Drawn(loft([ring(n, z, inner=inner) for z in _heights(rng)], bent=False), f"D{n}h")


def star(rng: Rng, n: int | None = None) -> Drawn:
    """Dnh: a right prism over a star with ``n`` tips."""
    n = _corners(rng, n, 3, 24)
    inner = float(rng.uniform(0.35, 0.6))
    return Drawn(loft([ring(n, z, inner=inner) for z in _heights(rng)], bent=False), f"D{n}h")


def antiprism(rng: Rng, n: int | None = None) -> Drawn:
    """Dnd: a star below, the same star rotated by half its spacing above."""
    n = _corners(rng, n, 2, 12)
    inner, (low, high) = float(rng.uniform(0.4, 0.65)), _heights(rng)
    step = np.pi / n
    rings = [ring(n, low, inner=inner, phase=-step / 2.0), ring(n, high, inner=inner, phase=step / 2.0)]
    # both rings start at the same angle: the upper one with a notch
    rings[1] = np.roll(rings[1], 1, axis=0)
    return Drawn(loft(rings), f"D{n}d")


def cuboid(rng: Rng) -> Drawn:
    """D2h: a box with three clearly different edges."""
    long, middle, short = 1.0, float(rng.uniform(0.55, 0.75)), float(rng.uniform(0.12, 0.38))
    return Drawn(box((long, middle, short)), "D2h")


def polyhedron(rng: Rng, solid: str | None = None) -> Drawn:
    """Td, Oh or Ih: one of the five Platonic solids, by name."""
    groups = {
        "tetrahedron": "Td",
        "cube": "Oh",
        "octahedron": "Oh",
        "dodecahedron": "Ih",
        "icosahedron": "Ih",
    }
    solid = str(rng.choice(list(groups))) if solid is None else solid
    return Drawn(regular_solid(solid), groups[solid])


def decorated(rng: Rng, group: str | None = None) -> Drawn:
    """T, Th, Td, O, Oh, I or Ih: a cluster of irregular solids."""
    return orbit_shape(rng, str(rng.choice(["T", "Th", "Td", "O", "Oh", "I", "Ih"])) if group is None else group)


def cylinder(rng: Rng, segments: int = 96) -> Drawn:
    """Dinfh: a drum, a disc or a rod; half of them are pipes."""
    low, high = _heights(rng)
    if rng.random() < 0.5:
        return Drawn(revolve(np.array([[1.0, low], [1.0, high]]), segments), "Dinfh", segments=segments)
    bore = float(rng.uniform(0.3, 0.8))
    profile = np.array([[bore, low], [1.0, low], [1.0, high], [bore, high]])
    return Drawn(revolve(profile, segments, closed=True), "Dinfh", segments=segments)


def cone(rng: Rng, segments: int = 96) -> Drawn:
    """Cinfv: a cone."""
    height = float(rng.uniform(0.6, 2.5))
    return Drawn(revolve(np.array([[1.0, 0.0]]), segments, ends=(0.0, height)), "Cinfv", segments=segments)


def torus(rng: Rng, segments: int = 96) -> Drawn:
    """Dinfh: a ring."""
    tube, angle = float(rng.uniform(0.15, 0.45)), np.arange(24) * (2.0 * np.pi / 24.0)
    profile = np.stack([1.0 + tube * np.cos(angle), tube * np.sin(angle)], axis=1)
    return Drawn(revolve(profile, segments, closed=True), "Dinfh", segments=segments)


def vase(rng: Rng, segments: int = 96) -> Drawn:
    """Cinfv: a body of revolution, clearly wider at one end."""
    height, t = float(rng.uniform(1.5, 3.0)), np.linspace(0.0, 1.0, 25)
    radius = (
        0.45
        + rng.uniform(0.25, 0.5) * (1.0 - t)
        + rng.uniform(0.08, 0.2) * np.sin(2.0 * np.pi * t + rng.uniform(0.0, 1.0))
    )
    profile = np.stack([radius, height * (t - 0.5)], axis=1)
    return Drawn(revolve(profile, segments), "Cinfv", segments=segments)


def spindle(rng: Rng, segments: int = 96) -> Drawn:
    """Dinfh: a body of revolution, the same at both ends."""
    height, t = float(rng.uniform(1.5, 3.0)), np.linspace(-1.0, 1.0, 25)
    radius = 0.5 + rng.uniform(-0.2, 0.25) * np.cos(np.pi * t) + rng.uniform(0.05, 0.15) * np.cos(3.0 * np.pi * t)
    return Drawn(revolve(np.stack([radius, 0.5 * height * t], axis=1), segments), "Dinfh", segments=segments)


def sphere(rng: Rng, subdivisions: int = 4) -> Drawn:
    """Kh: a geodesic sphere; with 4 subdivisions flat to 0.1 % of its radius."""
    del rng  # every sphere is the same
    return Drawn(geodesic_sphere(subdivisions), "Kh")


def _corners(rng: Rng, n: int | None, least: int, most: int) -> int:
    if n is None:
        return int(rng.integers(least, most + 1))
    if n < least:
        raise ValueError(f"n is at least {least} here, not {n}")
    return n


def _notch(rng: Rng, n: int) -> float | None:
    """Return how deep the notches of a star are, or None for a plain polygon (which needs three corners)."""
    return float(rng.uniform(0.4, 0.65)) if n == 2 or rng.random() < 0.4 else None


def _heights(rng: Rng) -> tuple[float, float]:
    """Return bottom and top of a prism over the unit circle: flat or tall, never near a cube's."""
    half = float(rng.uniform(0.15, 0.5) if rng.random() < 0.5 else rng.uniform(0.95, 1.5))
    return -half, half


def _twisted(rng: Rng, n: int, taper: float) -> Solid:
    """Return a star prism twisted by about half its spacing: Dn, or Cn where ``taper`` scales the top."""
    inner, height = float(rng.uniform(0.35, 0.55)), float(rng.uniform(0.6, 1.0))
    twist = float(rng.uniform(0.35, 0.65)) * 2.0 * np.pi / n
    rings = [
        ring(n, height * t, radius=1.0 + (taper - 1.0) * (0.5 + 0.5 * t), inner=inner, phase=0.5 * twist * t)
        for t in np.linspace(-1.0, 1.0, 7)
    ]
    return loft(rings)


FAMILIES: dict[str, Callable[..., Drawn]] = {
    "none": none,
    "mirror": mirror,
    "inversion": inversion,
    "improper": improper,
    "cyclic": cyclic,
    "dihedral": dihedral,
    "pyramid": pyramid,
    "gear": gear,
    "prism": prism,
    "star": star,
    "antiprism": antiprism,
    "box": cuboid,
    "polyhedron": polyhedron,
    "decorated": decorated,
    "orbit": orbit_shape,
    "cylinder": cylinder,
    "cone": cone,
    "torus": torus,
    "vase": vase,
    "spindle": spindle,
    "sphere": sphere,
}
