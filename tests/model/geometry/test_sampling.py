import numpy as np
import pytest
import trimesh

from model.errors import DegenerateMeshError
from model.geometry.sampling import extreme_vertices, sample_surface
from model.geometry.surface import SurfaceIndex
from tests.shapes import box


def uneven():
    """A mesh whose faces differ much in area, some of them without any."""
    rng = np.random.default_rng(21)
    triangles = rng.normal(size=(40, 3, 3)) * rng.uniform(0.1, 3, (40, 1, 1))
    triangles[::7, 2] = triangles[::7, 1]
    vertices = triangles.reshape(-1, 3)
    faces = np.arange(120, dtype=np.int32).reshape(-1, 3)
    areas = 0.5 * np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    return vertices, faces, areas


def test_points_lie_on_the_faces_named():
    vertices, faces, areas = uneven()
    points, owners = sample_surface(vertices, faces, 2000, seed=1)
    assert points.shape == (2000, 3)
    assert areas[owners].min() > 0
    for face in np.unique(owners):
        index = SurfaceIndex(vertices, faces[face : face + 1])
        assert index.squared_distances(points[owners == face]).max() < 1e-28


def test_faces_receive_points_by_area():
    vertices, faces, areas = uneven()
    for count in (10, 1000, 10_000):
        _, owners = sample_surface(vertices, faces, count, seed=2)
        expected = count * areas / areas.sum()
        # Strips of equal area: a face can gain or lose one point at each of its two ends, never more.
        assert np.abs(np.bincount(owners, minlength=len(faces)) - expected).max() <= 2


def test_points_are_uniform_inside_a_face():
    # In a triangle cut into 16 similar ones, each must get its share: a chi-square bound far in the tail (15 degrees).
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]])
    points, _ = sample_surface(vertices, np.array([[0, 1, 2]]), 16_000, seed=3)
    x, y = 4 * points[:, 0], 4 * points[:, 1]
    upper = (x % 1 + y % 1) > 1
    cells = np.unique(np.floor(x) * 8 + np.floor(y) * 2 + upper, return_counts=True)[1]
    assert len(cells) == 16
    assert ((cells - 1000.0) ** 2 / 1000).sum() < 45


def test_mean_of_the_points_is_the_centroid():
    mesh = trimesh.creation.cone(1, 2)
    points, _ = sample_surface(mesh.vertices, mesh.faces, 20_000, seed=4)
    assert np.abs(points.mean(axis=0) - mesh.centroid).max() < 2e-3


def test_same_seed_same_points_other_seed_other_points():
    vertices, faces, _ = uneven()
    first, owners = sample_surface(vertices, faces, 500, seed=5)
    again, owners_again = sample_surface(vertices, faces, 500, seed=5)
    assert np.array_equal(first, again)
    assert np.array_equal(owners, owners_again)
    assert not np.array_equal(first, sample_surface(vertices, faces, 500, seed=6)[0])


def test_no_points_asked_for():
    points, owners = sample_surface(*uneven()[:2], 0, seed=7)
    assert points.shape == (0, 3)
    assert owners.shape == (0,)


def test_no_area_is_an_error():
    with pytest.raises(DegenerateMeshError):
        sample_surface(np.zeros((3, 3)), np.array([[0, 1, 2]]), 10, seed=8)


def test_extreme_vertices_are_the_corners_that_reach_farthest():
    mesh = box(1.0, 2.0, 3.0)
    extra = np.vstack([mesh.vertices, [[50.0, 0.0, 0.0]]])  # no face uses it
    directions = np.array([[1.0, 1.0, 1.0], [-1.0, 0.5, 0.2], [1.0, 1.0, 0.9]])
    found = extreme_vertices(extra, mesh.faces, directions)
    assert sorted(found.tolist()) == [[-0.5, 1.0, 1.5], [0.5, 1.0, 1.5]]
