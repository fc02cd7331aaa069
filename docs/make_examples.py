"""Writes the viewer's examples into app/viewer/examples: `python docs/make_examples.py`, from the repository's root.

Three are copied from tests/data (Kenney and Quaternius, CC0-1.0), the others are built here. Their pictures are made by
`docs/make_screenshots.py`.
"""

import shutil
from pathlib import Path

import numpy as np
import trimesh

from training.shapes.point_groups import rotation
from training.shapes.solids import Solid, loft, merge, moved, orbit, regular_solid, revolve, ring

ROOT = Path(__file__).parents[1]
TARGET = ROOT / "app" / "viewer" / "examples"
COPIED = ("chair.obj", "vase.ply", "plant.off")
Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def propeller(blades: int = 5) -> Solid:
    """Twisted blades around a hub; they look along z."""
    sections = []
    for share in np.linspace(0.0, 1.0, 9):
        width, thickness = 0.11 + 0.13 * np.sin(np.pi * (0.15 + 0.8 * share)), 0.035 * (1.0 - 0.75 * share)
        angles = 2.0 * np.pi * np.arange(14) / 14
        outline = np.stack([width * np.cos(angles), thickness * np.sin(angles)], axis=1)
        pitch = np.deg2rad(62.0 - 38.0 * share)
        cos, sin = np.cos(pitch), np.sin(pitch)
        outline = outline @ np.array([[cos, sin], [-sin, cos]])
        sections.append(np.column_stack([outline, np.full(14, 0.12 + 0.88 * share)]))
    blade = loft(sections)
    # The loft grows along z; a blade grows along x and turns its outline in y and z.
    blade = moved(blade, np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]))
    turns = np.stack([rotation((0.0, 0.0, 1.0), 2.0 * np.pi * k / blades) for k in range(blades)])
    height = np.linspace(-0.14, 0.24, 12)
    radius = 0.2 * np.sqrt(np.clip(1.0 - ((height - 0.02) / 0.24) ** 2, 0.03, 1.0))
    hub = revolve(np.stack([radius, height], axis=1), 10 * blades)
    return merge(hub, orbit(blade, turns))


def nut(points: int = 72) -> Solid:
    """A hexagonal nut with its round hole along z, its corners chamfered."""
    angles = 2.0 * np.pi * np.arange(points) / points
    hexagon = 1.0 / np.cos((angles % (np.pi / 3.0)) - np.pi / 6.0) * np.cos(np.pi / 6.0)

    def outline(radius: np.ndarray | float, height: float) -> np.ndarray:
        return ring(points, height) * np.column_stack(
            [np.full((points, 2), 1.0) * np.reshape(radius, (-1, 1)), np.ones(points)]
        )

    rounded = np.minimum(hexagon, 0.9)
    drop = 0.08 * (hexagon - rounded) / (hexagon - rounded).max()
    rings = []
    for side in (-1.0, 1.0):
        low = outline(hexagon, 0.0)
        low[:, 2] = side * (0.4 - drop)
        pair = [outline(0.5, side * 0.34), outline(0.56, side * 0.4), outline(rounded, side * 0.4), low]
        rings += pair if side < 0 else pair[::-1]
    return loft(rings, closed=True)


def star() -> Solid:
    """A spike on every face of an icosahedron."""
    corners, faces = regular_solid("icosahedron")
    tips = corners[faces].mean(axis=1)
    tips *= 1.75 / np.linalg.norm(tips, axis=1, keepdims=True)
    new = len(corners) + np.arange(len(faces))
    sides = [np.stack([faces[:, i], faces[:, (i + 1) % 3], new], axis=1) for i in range(3)]
    return np.concatenate([corners, tips]), np.concatenate(sides).astype(np.int32)


def bottle(segments: int = 128) -> Solid:
    """A surface of revolution about z."""
    profile = [
        (0.30, 0.00), (0.34, 0.015), (0.36, 0.06), (0.36, 0.62), (0.355, 0.70), (0.335, 0.78), (0.29, 0.86),
        (0.23, 0.93), (0.17, 0.985), (0.135, 1.04), (0.12, 1.10), (0.115, 1.24), (0.115, 1.26), (0.14, 1.265),
        (0.145, 1.29), (0.14, 1.315), (0.12, 1.32), (0.10, 1.32),
    ]  # fmt: skip
    return revolve(np.array(profile), segments)


def broken_table() -> Solid:
    """A table with a turned-down rim, of which a corner with most of its leg is missing."""
    parts = [trimesh.creation.box((1.5, 1.0, 0.07), trimesh.transformations.translation_matrix((0, 0, 0.72)))]
    for x in (-0.64, 0.64):
        for y in (-0.4, 0.4):
            parts.append(
                trimesh.creation.box((0.09, 0.09, 0.69), trimesh.transformations.translation_matrix((x, y, 0.345)))
            )
    for y in (-0.4, 0.4):
        parts.append(trimesh.creation.box((1.2, 0.04, 0.1), trimesh.transformations.translation_matrix((0, y, 0.63))))
    vertices, faces = trimesh.remesh.subdivide_to_size(*_joined(parts), max_edge=0.09)
    centre = np.array([0.72, 0.46, 0.66])
    kept = np.linalg.norm(vertices[faces].mean(axis=1) - centre, axis=1) > 0.3
    mesh = trimesh.Trimesh(vertices, faces[kept], process=True)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int32)


def _joined(parts: list[trimesh.Trimesh]) -> tuple[np.ndarray, np.ndarray]:
    joined = trimesh.util.concatenate(parts)
    return np.asarray(joined.vertices), np.asarray(joined.faces)


def write(name: str, solid: Solid) -> None:
    """The solid as a file; z is up in STL and 3MF, y in the others, as the viewer takes it to be."""
    if not name.endswith((".stl", ".3mf")):
        solid = moved(solid, Y_UP)
    mesh = trimesh.Trimesh(*solid, process=False)
    options = {"include_normals": False} if name.endswith((".obj", ".glb")) else {}
    mesh.export(TARGET / name, **options)


def main() -> None:
    """Write all of them."""
    TARGET.mkdir(parents=True, exist_ok=True)
    for name in COPIED:
        shutil.copy(ROOT / "tests" / "data" / name, TARGET / name)
    write("propeller.stl", propeller())
    write("nut.glb", nut())
    write("star.ply", star())
    write("bottle.obj", bottle())
    write("broken.3mf", broken_table())


if __name__ == "__main__":
    main()
