"""Completing, symmetrizing and halving, judged by exact distances to the mesh that was there before the damage."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from model import Detector
from model.completion.halving import halve, merged
from model.completion.mirroring import Completed, complete
from model.errors import DegenerateMeshError
from model.formats.conversion import as_mesh
from model.geometry.frames import UnitFrame, triangle_areas
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect
from model.meshes.mesh import Mesh
from model.types import FloatArray, IntArray
from training.evaluation.corruptions import add_noise

DATA = Path(__file__).parents[2] / "data"
NAMES = ["chair.obj", "table.glb", "stool.3mf", "vase.ply", "barrel.stl"]


def half_of(mesh: Mesh, plane: FloatArray, *, positive: bool = True) -> tuple[FloatArray, IntArray]:
    half = halve(mesh, plane, positive=positive)
    return half.vertices, half.faces


@pytest.fixture(scope="module")
def detector() -> Detector:
    return Detector.load()


def shape(name: str, detector: Detector) -> tuple[Mesh, np.ndarray]:
    """A mesh away from the origin, and its best plane."""
    mesh = as_mesh(DATA / name)
    mesh = Mesh.checked(mesh.vertices * 40.0 + [7.0, -300.0, 11.0], mesh.faces)
    plane = detector.detect(mesh).planes[0]
    return mesh, np.append(plane.normal, plane.offset)


def far_apart(first: Mesh, second: Mesh) -> float:
    """The largest distance of samples of either surface from the other, as a share of the first one's diameter."""
    farthest = 0.0
    for a, b in ((first, second), (second, first)):
        samples, _ = sample_surface(a.vertices, a.faces, 4000, seed=3)
        farthest = max(farthest, SurfaceIndex(b.vertices, b.faces).squared_distances(samples).max())
    return float(np.sqrt(farthest)) / UnitFrame.of(first.vertices, first.faces).scale


def as_result(done: Completed) -> Mesh:
    return Mesh.checked(done.vertices, done.faces)


def without_ball(mesh: Mesh, centre: np.ndarray, radius: float) -> Mesh:
    """The mesh without the triangles whose middle is in a ball."""
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    return Mesh.checked(mesh.vertices, mesh.faces[np.linalg.norm(middle - centre, axis=1) >= radius])


def asymmetry(mesh: Mesh, plane: np.ndarray) -> float:
    samples, _ = sample_surface(mesh.vertices, mesh.faces, 3000, seed=5)
    surface = SurfaceIndex(mesh.vertices, mesh.faces)
    return surface.mean_squared_distance(reflect(samples, plane)) / UnitFrame.of(mesh.vertices, mesh.faces).scale ** 2


@pytest.mark.parametrize("name", NAMES)
def test_a_half_becomes_the_whole_again(name: str, detector: Detector) -> None:
    mesh, plane = shape(name, detector)
    half = Mesh.checked(*half_of(mesh, plane))
    done = complete(half, plane)
    result = as_result(done)
    assert far_apart(mesh, result) < 1e-3
    assert asymmetry(result, plane) < 1e-8
    assert done.area_added == pytest.approx(1.0, abs=0.01)
    assert result.watertight or not mesh.watertight
    assert done.seam_distance <= 2e-4 * UnitFrame.of(half.vertices, half.faces).scale


@pytest.mark.parametrize("name", NAMES)
def test_what_is_symmetric_gains_nothing_and_keeps_its_coordinates(name: str, detector: Detector) -> None:
    mesh, plane = shape(name, detector)
    done = complete(mesh, plane)
    vertices, faces = merged(mesh)
    assert done.area_added == 0.0
    assert (done.vertices == vertices).all()
    assert (done.faces == faces).all()
    assert (done.vertices_kept, done.faces_kept) == (len(vertices), len(faces))


@pytest.mark.parametrize("name", ["table.glb", "vase.ply", "barrel.stl"])
def test_a_hole_on_one_side_is_filled(name: str, detector: Detector) -> None:
    mesh, plane = shape(name, detector)
    scale = UnitFrame.of(mesh.vertices, mesh.faces).scale
    corners = mesh.vertices[mesh.faces]
    height = corners.mean(axis=1) @ plane[:3] + plane[3]
    damaged = without_ball(mesh, corners.mean(axis=1)[np.argmax(height)], 0.2 * scale)
    kept = damaged.vertices[damaged.faces].mean(axis=1) @ plane[:3] + plane[3]
    assert kept.min() < -0.99 * height.max()
    done = complete(damaged, plane)
    result = as_result(done)
    lost = mesh.area / damaged.area - 1.0
    assert lost > 0.05
    assert done.area_added == pytest.approx(lost, rel=0.01)
    assert far_apart(mesh, result) < 1e-4
    assert asymmetry(result, plane) < 1e-7
    # What was there is there, in the same place.
    vertices, _ = merged(damaged)
    assert (done.vertices[: len(vertices)] == vertices).all()
    assert len(done.faces) > done.faces_kept


def test_border_of_a_hole_that_crosses_the_triangles_of_the_other_side(detector: Detector) -> None:
    mesh, plane = shape("table.glb", detector)
    cut = np.array([0.6, 0.5, 0.62, 0.0])
    cut[:3] /= np.linalg.norm(cut[:3])
    cut[3] = -cut[:3] @ UnitFrame.of(mesh.vertices, mesh.faces).center
    damaged = Mesh.checked(*half_of(mesh, cut))
    done = complete(damaged, plane)
    result = as_result(done)
    samples, _ = sample_surface(result.vertices, result.faces, 3000, seed=5)
    off = np.sqrt(SurfaceIndex(mesh.vertices, mesh.faces).squared_distances(samples))
    assert off.max() < 1e-3 * UnitFrame.of(mesh.vertices, mesh.faces).scale  # nothing that was never there
    assert asymmetry(result, plane) < 1e-7
    assert damaged.area < 0.9 * result.area <= 0.9 * 1.001 * mesh.area


def test_noise_is_no_reason_to_add_anything(detector: Detector) -> None:
    mesh, plane = shape("table.glb", detector)
    noisy = Mesh.checked(*add_noise(mesh.vertices, mesh.faces, np.random.default_rng(1)))
    done = complete(noisy, plane)
    assert done.area_added < 0.02
    assert done.tolerance > 1e-3 * UnitFrame.of(mesh.vertices, mesh.faces).scale


def test_symmetrize_makes_halves_that_are_mirror_images_to_rounding(detector: Detector) -> None:
    mesh, plane = shape("chair.obj", detector)
    noisy = Mesh.checked(*add_noise(mesh.vertices, mesh.faces, np.random.default_rng(1)))
    result = as_result(complete(noisy, plane, symmetrize=True))
    scale = UnitFrame.of(mesh.vertices, mesh.faces).scale
    assert asymmetry(noisy, plane) > 1e-6
    mirrored = reflect(result.vertices, plane)
    nearest = SurfaceIndex(result.vertices, np.repeat(np.arange(len(result.vertices))[:, None], 3, axis=1))
    assert np.sqrt(nearest.squared_distances(mirrored)).max() < 1e-9 * scale
    # Averaging takes away noise: the result is nearer to the chair than what it was made from.
    chair = SurfaceIndex(mesh.vertices, mesh.faces)
    off = [chair.mean_squared_distance(sample_surface(it.vertices, it.faces, 4000, 0)[0]) for it in (result, noisy)]
    assert off[0] < 0.8 * off[1]
    assert result.area == pytest.approx(noisy.area, rel=0.1)


@pytest.mark.parametrize("name", NAMES)
def test_halves_are_cut_at_the_plane_and_add_up(name: str, detector: Detector) -> None:
    mesh, plane = shape(name, detector)
    scale = UnitFrame.of(mesh.vertices, mesh.faces).scale
    plane = np.append(plane[:3], plane[3] + 0.07 * scale)  # through the middle of triangles
    halves = [half_of(mesh, plane, positive=side) for side in (True, False)]
    for (vertices, faces), sign in zip(halves, (1.0, -1.0), strict=True):
        heights = sign * (vertices @ plane[:3] + plane[3])
        assert heights.min() > -1e-9 * scale
        assert np.unique(faces).tolist() == list(range(len(vertices)))
    total = sum(triangle_areas(vertices[faces]).sum() for vertices, faces in halves)
    assert total == pytest.approx(mesh.area, rel=1e-9)


def test_a_plane_that_misses_the_mesh_leaves_nothing_on_one_side(detector: Detector) -> None:
    mesh, _ = shape("chair.obj", detector)
    with pytest.raises(DegenerateMeshError, match="on that side"):
        half_of(mesh, np.array([1.0, 0.0, 0.0, -1e6]))


def test_what_only_one_side_has_is_added_to_the_other() -> None:
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    arm = corners * [0.5, 0.1, 0.1] + [1.6, 0.0, 0.0]
    mesh = Mesh.checked(np.concatenate([corners, arm]), np.concatenate([faces, faces + 8]))
    done = complete(mesh, np.array([1.0, 0.0, 0.0, 0.0]))
    result = as_result(done)
    assert result.bounds[:, 0].tolist() == pytest.approx([-2.1, 2.1])
    assert done.faces_kept == 24
    areas, middle = triangle_areas(result.vertices[result.faces]), result.vertices[result.faces].mean(axis=1)[:, 0]
    assert areas[middle < -1.05].sum() == pytest.approx(areas[middle > 1.05].sum())
    # Turned the same way: by the divergence theorem both arms have a positive volume.
    corners = result.vertices[result.faces[middle < -1.05]] + [1.6, 0.0, 0.0]
    volume = np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    assert volume == pytest.approx(0.04)


def glued(other_cut: bool) -> Mesh:
    """Two closed boxes that meet at x = 0, each with a wall of its own there; the walls may be cut differently."""
    left, right = trimesh.creation.box((2, 2, 2)), trimesh.creation.box((2, 2, 2))
    left.apply_translation([-1, 0, 0])
    right.apply_translation([1, 0, 0])
    if other_cut:
        right = right.subdivide()
    joined = trimesh.util.concatenate([left, right])
    return Mesh.checked(joined.vertices, joined.faces)


@pytest.mark.parametrize("other_cut", [False, True])
@pytest.mark.parametrize("positive", [False, True])
def test_a_double_wall_in_the_plane_is_kept_once(other_cut: bool, positive: bool) -> None:
    vertices, faces = half_of(glued(other_cut), np.array([1.0, 0, 0, 0]), positive=positive)
    half = trimesh.Trimesh(vertices, faces, process=False)
    assert half.area == pytest.approx(24.0)
    assert half.is_watertight
    assert half.volume == pytest.approx(8.0)  # the wall looks away from the half


def test_a_copied_wall_is_kept_once_and_a_lone_one_stays() -> None:
    square = np.array([[0.0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1], [1, 0, 0]])
    wall = np.array([[0, 1, 2], [0, 2, 3]])
    plane = np.array([1.0, 0, 0, 0])
    for copies in (1, 2):
        for turned in (wall, wall[:, ::-1]):
            faces = np.concatenate([[[0, 1, 4]], *[turned] * copies])
            assert len(half_of(Mesh.checked(square, faces), plane)[1]) == 3
