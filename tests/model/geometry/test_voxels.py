import numpy as np
import pytest
import trimesh

from model.geometry.sampling import sample_surface
from model.geometry.voxels import voxelize

ONE_FACE = np.array([[0, 1, 2]], dtype=np.int32)


def clipped_touches(triangle, low, high):
    """Whether anything is left of a triangle that is cut at the six planes of a box (no separating axes here)."""
    polygon = list(triangle)
    for axis in range(3):
        for sign, limit in ((1.0, low[axis]), (-1.0, -high[axis])):
            heights = [sign * point[axis] - limit for point in polygon]
            kept = []
            for i, (point, height) in enumerate(zip(polygon, heights, strict=True)):
                following, next_height = polygon[(i + 1) % len(polygon)], heights[(i + 1) % len(polygon)]
                if height >= -1e-13:
                    kept.append(point)
                if (height < 0) != (next_height < 0):
                    kept.append(point + height / (height - next_height) * (following - point))
            polygon = kept
            if not polygon:
                return False
    return True


def reference(triangles, resolution):
    grid = np.zeros((resolution,) * 3, dtype=bool)
    for triangle in triangles:
        for index in np.ndindex(grid.shape):
            low = np.array(index) / resolution - 0.5
            grid[index] |= clipped_touches(triangle, low, low + 1 / resolution)
    return grid


def random_triangle(kind, rng):
    triangle = rng.uniform(-0.6, 0.6, (3, 3))
    match kind:
        case "sliver":
            triangle[2] = triangle[0] + rng.uniform() * (triangle[1] - triangle[0]) + rng.normal(size=3) * 1e-7
        case "on the grid":
            triangle = np.round(triangle * 8) / 8
        case "flat along an axis":
            triangle[:, rng.integers(3)] = rng.uniform(-0.5, 0.5)
        case "segment":
            triangle[2] = triangle[1]
        case "collinear":
            triangle[2] = triangle[0] + rng.uniform() * (triangle[1] - triangle[0])
        case "point":
            triangle[:] = triangle[0]
        case "small":
            triangle = triangle[0] * 0.7 + rng.normal(size=(3, 3)) * 0.05
        case "huge":
            triangle *= 50
    return triangle


@pytest.mark.parametrize(
    "kind",
    ["any", "sliver", "on the grid", "flat along an axis", "segment", "collinear", "point", "small", "huge"],
)
def test_occupied_iff_the_clipped_triangle_is_not_empty(kind):
    rng = np.random.default_rng(5)
    for _ in range(20):
        triangle = random_triangle(kind, rng)
        assert np.array_equal(voxelize(triangle, ONE_FACE, 8), reference([triangle], 8))


def test_many_triangles_are_the_union_of_each():
    rng = np.random.default_rng(6)
    triangles = rng.uniform(-0.4, 0.4, (12, 1, 3)) + rng.normal(size=(12, 3, 3)) * 0.1
    faces = np.arange(36, dtype=np.int32).reshape(-1, 3)
    assert np.array_equal(voxelize(triangles.reshape(-1, 3), faces, 8), reference(triangles, 8))


def test_closed_boxes_share_a_triangle_on_their_common_side():
    triangle = np.array([[0.0, 0.1, 0.1], [0.0, 0.15, 0.1], [0.0, 0.1, 0.15]])
    occupied = np.argwhere(voxelize(triangle, ONE_FACE, 4))
    assert occupied.tolist() == [[1, 2, 2], [2, 2, 2]]


def test_a_face_on_the_rim_of_the_cube_marks_the_outermost_layer():
    triangle = np.array([[0.5, 0.1, 0.1], [0.5, 0.15, 0.1], [0.5, 0.1, 0.15]])
    assert np.argwhere(voxelize(triangle, ONE_FACE, 4)).tolist() == [[3, 2, 2]]


def test_parts_outside_the_cube_are_ignored():
    outside = np.array([[0.6, 0, 0], [0.7, 0, 0], [0.6, 0.1, 0]])
    assert not voxelize(outside, ONE_FACE).any()


@pytest.mark.parametrize("resolution", [16, 32, 64])
def test_no_sampling_holes(resolution):
    rng = np.random.default_rng(7)
    mesh = trimesh.creation.torus(0.3, 0.12)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    vertices = np.ascontiguousarray(mesh.vertices @ turn)
    grid = voxelize(vertices, mesh.faces, resolution)
    points, _ = sample_surface(vertices, mesh.faces, 50_000, seed=1)
    x, y, z = np.floor((points + 0.5) * resolution).astype(int).T
    assert grid[x, y, z].all()


def test_only_voxels_near_the_surface_are_occupied():
    vertices = trimesh.creation.icosphere(subdivisions=4, radius=0.4).vertices
    grid = voxelize(vertices, trimesh.creation.icosphere(subdivisions=4).faces, 32)
    centres = (np.argwhere(grid) + 0.5) / 32 - 0.5
    # Half a voxel's diagonal, and how far the chords of the mesh lie below the sphere.
    assert np.abs(np.linalg.norm(centres, axis=1) - 0.4).max() < np.sqrt(3) / 64 + 0.002


def test_mirrored_input_gives_the_mirrored_grid():
    rng = np.random.default_rng(8)
    vertices = rng.uniform(-0.5, 0.5, (30, 3))
    faces = np.arange(30, dtype=np.int32).reshape(-1, 3)
    for axis in range(3):
        mirrored = vertices.copy()
        mirrored[:, axis] *= -1
        assert np.array_equal(voxelize(mirrored, faces), np.flip(voxelize(vertices, faces), axis))


def test_resolution_must_be_positive():
    with pytest.raises(ValueError, match="resolution"):
        voxelize(np.zeros((3, 3)), ONE_FACE, 0)
