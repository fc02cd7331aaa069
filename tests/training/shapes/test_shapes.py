"""The procedural shapes have exactly the symmetries they claim: their own hold, any others fail clearly."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from model.types import FloatArray
from training.shapes.catalogue import KnownShape, families, generate, posed, random_shape, write_shapes
from training.shapes.point_groups import group_elements, group_matrices, rotation
from training.shapes.solids import random_rotation

ROUND = ("cylinder", "cone", "torus", "vase", "spindle", "sphere")
EXACT = tuple(family for family in families() if family not in ROUND)
CLEAR = 1e-5  # symmetry error in the unit frame: ten times what the design calls a clear plane


def squared_distances(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Return the exact squared distances (n,) of points (n, 3) to triangles (f, 3, 3), by brute force."""
    a, b, c = (triangles[:, i] for i in range(3))
    best = np.full(len(points), np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        edge = q - p
        t = ((points[:, None] - p) * edge).sum(2) / (edge * edge).sum(1)
        foot = p + np.clip(t, 0.0, 1.0)[..., None] * edge
        best = np.minimum(best, ((points[:, None] - foot) ** 2).sum(2).min(1))
    normal = np.cross(b - a, c - a)
    height = ((points[:, None] - a) * normal).sum(2) / (normal * normal).sum(1)
    foot = points[:, None] - height[..., None] * normal
    inside = np.ones(height.shape, dtype=bool)
    for p, q in ((a, b), (b, c), (c, a)):
        inside &= (np.cross(q - p, foot - p) * normal).sum(2) >= 0
    over = np.where(inside, height**2 * (normal * normal).sum(1), np.inf)
    return np.minimum(best, over.min(1))


def surface_samples(shape: KnownShape, count: int) -> FloatArray:
    """Return points drawn uniformly from the surface (all bodies count, also where they overlap)."""
    rng = np.random.default_rng(0)
    a, b, c = shape.vertices[shape.faces].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    face = rng.choice(len(area), size=count, p=area / area.sum())
    u, v = rng.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return a[face] + u * (b - a)[face] + v * (c - a)[face]


def symmetry_error(shape: KnownShape, matrix: FloatArray, offset: FloatArray, count: int = 150) -> float:
    """Return the mean squared distance of moved samples to the surface, in the unit frame."""
    samples = surface_samples(shape, count)
    middle = samples.mean(axis=0)
    diameter = 2.0 * np.linalg.norm(shape.vertices - middle, axis=1).max()
    moved = samples @ matrix.T + offset
    return float(squared_distances(moved, shape.vertices[shape.faces]).mean() / diameter**2)


def reflection(plane: FloatArray) -> tuple[FloatArray, FloatArray]:
    normal, offset = plane[:3], plane[3]
    return np.eye(3) - 2.0 * np.outer(normal, normal), -2.0 * offset * normal


def turn(direction: FloatArray, point: FloatArray, angle: float) -> tuple[FloatArray, FloatArray]:
    matrix = rotation(direction, angle)
    return matrix, point - matrix @ point


def vertex_gap(shape: KnownShape, matrix: FloatArray, offset: FloatArray) -> float:
    """Return the largest distance of a moved vertex from its nearest vertex, relative to the extent."""
    gaps, _ = KDTree(shape.vertices).query(shape.vertices @ matrix.T + offset)
    return float(gaps.max() / np.ptp(shape.vertices, axis=0).max())


@pytest.mark.parametrize(
    ("name", "size", "planes", "orders"),
    [
        ("C1", 1, 0, []),
        ("Cs", 2, 1, []),
        ("Ci", 2, 0, []),
        ("C5", 5, 0, [5]),
        ("C4v", 8, 4, [4]),
        ("C6h", 12, 1, [6]),
        ("D7", 14, 0, [7] + [2] * 7),
        ("D2d", 8, 2, [2, 2, 2]),
        ("D5d", 20, 5, [5] + [2] * 5),
        ("D24h", 96, 25, [24] + [2] * 24),
        ("S2", 2, 0, []),
        ("S4", 4, 0, [2]),
        ("S6", 6, 0, [3]),
        ("T", 12, 0, [3] * 4 + [2] * 3),
        ("Th", 24, 3, [3] * 4 + [2] * 3),
        ("Td", 24, 6, [3] * 4 + [2] * 3),
        ("O", 24, 0, [4] * 3 + [3] * 4 + [2] * 6),
        ("Oh", 48, 9, [4] * 3 + [3] * 4 + [2] * 6),
        ("I", 60, 0, [5] * 6 + [3] * 10 + [2] * 15),
        ("Ih", 120, 15, [5] * 6 + [3] * 10 + [2] * 15),
    ],
)
def test_groups_have_the_elements_of_the_character_tables(name: str, size: int, planes: int, orders: list[int]) -> None:
    matrices, elements = group_matrices(name), group_elements(name)
    assert len(matrices) == size
    assert np.allclose(matrices @ matrices.transpose(0, 2, 1), np.eye(3), atol=1e-12)
    assert len(elements.planes) == planes
    assert sorted(elements.orders, reverse=True) == orders


@pytest.mark.parametrize("name", ["Cinfv", "Kh", "C0", "C1v", "D1", "S3", "C4d", "D3v", "X", ""])
def test_other_names_are_no_finite_groups(name: str) -> None:
    with pytest.raises(ValueError, match="finite point group"):
        group_matrices(name)


@pytest.mark.parametrize("family", EXACT)
def test_every_listed_plane_and_axis_maps_the_vertices_to_themselves(family: str) -> None:
    shape = generate(family, np.random.default_rng(3), pose=True)
    for plane in shape.planes:
        assert vertex_gap(shape, *reflection(plane)) < 1e-9
    for axis in shape.axes:
        assert axis.order is not None
        assert vertex_gap(shape, *turn(axis.direction, axis.point, 2.0 * np.pi / axis.order)) < 1e-9


@pytest.mark.parametrize(
    ("group", "larger"),
    [
        ("Cs", "D2h"),
        ("Ci", "D2h"),
        ("C3", "D6h"),
        ("C2v", "D4h"),
        ("C3h", "D6h"),
        ("D4", "D4h"),
        ("D3h", "D6h"),
        ("D2d", "D4h"),
        ("S4", "D4h"),
        ("T", "Oh"),
        ("Td", "Oh"),
        ("Th", "Oh"),
        ("O", "Oh"),
        ("I", "Ih"),
    ],
)
def test_orbit_shapes_have_their_whole_group_and_clearly_no_more(group: str, larger: str) -> None:
    shape = generate("orbit", np.random.default_rng(5), group=group)
    matrices = group_matrices(group)
    assert shape.point_group == group
    for matrix in matrices:
        assert vertex_gap(shape, matrix, np.zeros(3)) < 1e-9
    others = [m for m in group_matrices(larger) if np.abs(matrices - m).max(axis=(1, 2)).min() > 1e-6]
    assert len(others) == len(group_matrices(larger)) - len(matrices)
    for matrix in others[:8]:
        assert symmetry_error(shape, matrix, np.zeros(3), count=60) > CLEAR


@pytest.mark.parametrize("family", EXACT)
def test_a_listed_order_is_the_largest(family: str) -> None:
    shape = generate(family, np.random.default_rng(7))
    for axis in sorted(shape.axes, key=lambda a: a.order or 0)[-2:]:
        assert axis.order is not None
        for multiple in (2, 3):
            angle = 2.0 * np.pi / (multiple * axis.order)
            assert symmetry_error(shape, *turn(axis.direction, axis.point, angle), count=80) > CLEAR


@pytest.mark.parametrize("family", ["none", "inversion", "improper", "cyclic", "dihedral"])
@pytest.mark.parametrize("seed", [0, 1])
def test_shapes_without_planes_fail_every_plane_tried(family: str, seed: int) -> None:
    shape = generate(family, np.random.default_rng(seed))
    assert len(shape.planes) == 0
    middle = surface_samples(shape, 2000).mean(axis=0)
    around = [rotation((0.0, 0.0, 1.0), angle)[0] for angle in np.linspace(0.0, np.pi, 24, endpoint=False)]
    elsewhere = np.random.default_rng(9).normal(size=(60, 3))
    for normal in [*np.eye(3), *around, *(elsewhere / np.linalg.norm(elsewhere, axis=1, keepdims=True))]:
        assert symmetry_error(shape, *reflection(np.append(normal, -normal @ middle)), count=60) > CLEAR


@pytest.mark.parametrize("family", [family for family in ROUND if family != "sphere"])
def test_surfaces_of_revolution_hold_for_every_step_of_their_tessellation(family: str) -> None:
    shape = generate(family, np.random.default_rng(11), pose=True, segments=48)
    (axis,) = shape.continuous_axes
    assert shape.segments == 48
    for steps in (1, 5, 24):
        assert vertex_gap(shape, *turn(axis.direction, axis.point, 2.0 * np.pi * steps / 48)) < 1e-9
    assert symmetry_error(shape, *turn(axis.direction, axis.point, 1.2345)) < 1e-6  # chords, not arcs
    assert len(shape.planes) == (shape.point_group == "Dinfh")
    for plane in shape.planes:
        assert abs(plane[:3] @ axis.direction) == pytest.approx(1.0)
        assert vertex_gap(shape, *reflection(plane)) < 1e-9


@pytest.mark.parametrize("family", ["cone", "vase"])
def test_the_ends_of_a_cone_or_vase_differ(family: str) -> None:
    shape = generate(family, np.random.default_rng(13), segments=48)
    height = surface_samples(shape, 2000).mean(axis=0)[2]
    assert symmetry_error(shape, *reflection(np.array([0.0, 0.0, 1.0, -height]))) > CLEAR


def test_sphere_is_round_to_its_tessellation() -> None:
    shape = generate("sphere", np.random.default_rng(0), subdivisions=3)
    assert np.linalg.norm(shape.vertices, axis=1) == pytest.approx(1.0)
    distance = np.linalg.norm(shape.vertices[shape.faces].mean(axis=1), axis=1)
    assert distance.min() > 0.99
    assert len(shape.continuous_axes) == len(shape.planes) == 3


@pytest.mark.parametrize("family", families())
def test_meshes_are_closed_and_look_outwards(family: str) -> None:
    shape = generate(family, np.random.default_rng(17), pose=True)
    assert shape.vertices.dtype == np.float64
    assert shape.faces.dtype == np.int32
    corners = shape.vertices[shape.faces]
    assert np.linalg.norm(np.cross(*(corners[:, 1:] - corners[:, :1]).transpose(1, 0, 2)), axis=1).min() > 0
    assert np.linalg.det(corners - shape.vertices.mean(axis=0)).sum() > 0
    edges = shape.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    forth = np.unique(edges, axis=0, return_counts=True)
    back = np.unique(edges[:, ::-1], axis=0, return_counts=True)
    assert np.array_equal(forth[0], back[0])
    assert np.array_equal(forth[1], back[1])


def test_planes_and_axes_are_unit_and_signed() -> None:
    for seed in range(20):
        shape = random_shape(np.random.default_rng(seed), pose=True)
        for vector in [*shape.planes[:, :3], *(axis.direction for axis in shape.axes)]:
            assert np.linalg.norm(vector) == pytest.approx(1.0)
            assert vector[np.abs(vector) > 1e-9][0] > 0


def test_pose_moves_planes_and_axes_along() -> None:
    rng = np.random.default_rng(19)
    shape = generate("antiprism", rng, n=3)
    matrix, shift = random_rotation(rng), np.array([3.0, -2.0, 0.5])
    moved = posed(shape, matrix, shift, 4.0)
    assert np.allclose(moved.vertices, 4.0 * shape.vertices @ matrix.T + shift)
    assert len(moved.planes) == 3
    for plane in moved.planes:
        assert plane[:3] @ shift + plane[3] == pytest.approx(0.0, abs=1e-9)
        assert vertex_gap(moved, *reflection(plane)) < 1e-9
    with pytest.raises(ValueError, match="proper rotation"):
        posed(shape, -matrix, shift)
    with pytest.raises(ValueError, match="positive scale"):
        posed(shape, matrix, shift, 0.0)


def test_parameters_are_honoured_and_strange_ones_refused() -> None:
    rng = np.random.default_rng(23)
    assert generate("prism", rng, n=24).point_group == "D24h"
    assert generate("improper", rng, n=3).point_group == "S6"
    assert generate("table", rng, square=True).point_group == "C4v"
    assert generate("polyhedron", rng, solid="dodecahedron").point_group == "Ih"
    with pytest.raises(ValueError, match="no family"):
        generate("teapot", rng)
    with pytest.raises(ValueError, match="at least 3"):
        generate("star", rng, n=2)


def test_the_same_seed_gives_the_same_shape_and_another_seed_another() -> None:
    first, second, third = (generate("chair", np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(first.vertices, second.vertices)
    assert not np.array_equal(first.vertices, third.vertices)


def test_written_files_hold_the_shape_and_its_symmetries(tmp_path: Path) -> None:
    paths = write_shapes(tmp_path / "shapes", 2, 7, only=["prism", "cone"])
    truth = json.loads((tmp_path / "shapes" / "ground_truth.json").read_text())
    assert [path.name for path in paths] == list(truth)
    shape = generate("prism", np.random.default_rng([7, 0]), pose=True)
    entry = truth[paths[0].name]
    assert entry["point_group"] == shape.point_group
    assert np.array_equal(np.array(entry["planes"]), shape.planes)
    assert truth[paths[1].name]["axes"][0]["order"] is None
    header, body = paths[0].read_bytes().split(b"end_header\n")
    assert f"element vertex {len(shape.vertices)}\n".encode() in header
    vertices = np.frombuffer(body, dtype="<f8", count=shape.vertices.size).reshape(-1, 3)
    assert np.array_equal(vertices, shape.vertices)
    assert len(body) == shape.vertices.nbytes + 13 * len(shape.faces)
