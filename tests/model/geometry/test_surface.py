import threading

import numpy as np
import pytest
import trimesh

from model.geometry import surface
from model.geometry._bvh_query import search
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex


@pytest.fixture(autouse=True, params=[0, 3_000], ids=["cells", "split"])
def both_ways_to_build(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Trees of small meshes are split down to the leaves; here also sorted into cells, as those of large ones are."""
    monkeypatch.setattr(surface, "_FEW", request.param)


def segment_distances(points, a, b):
    """(n,) distances of points from the segment a-b."""
    direction = b - a
    length = direction @ direction
    t = np.clip((points - a) @ direction / length, 0, 1) if length > 0 else np.zeros(len(points))
    return np.linalg.norm(points - (a + t[:, None] * direction), axis=1)


def brute_force(points, triangles):
    """(n,) smallest distance over all triangles: to the three sides, and to the plane where the foot lies inside."""
    best = np.full(len(points), np.inf)
    for a, b, c in triangles:
        for start, end in ((a, b), (b, c), (c, a)):
            best = np.minimum(best, segment_distances(points, start, end))
        normal = np.cross(b - a, c - a)
        size = np.linalg.norm(normal)
        if size <= 1e-9 * max(np.linalg.norm(b - a), np.linalg.norm(c - a)) ** 2:
            continue  # so thin that the sides say it all
        normal /= size
        inside = np.ones(len(points), dtype=bool)
        for start, end in ((a, b), (b, c), (c, a)):
            inside &= (points - start) @ np.cross(normal, end - start) >= 0
        best = np.where(inside, np.minimum(best, np.abs((points - a) @ normal)), best)
    return best


def separate(triangles):
    """Vertices and faces of triangles that share nothing."""
    triangles = np.asarray(triangles, dtype=float)
    return triangles.reshape(-1, 3), np.arange(3 * len(triangles), dtype=np.int32).reshape(-1, 3)


def soup(kind, rng):
    """(t, 3, 3) triangles of one awkward sort."""
    triangles = rng.uniform(-0.5, 0.5, (60, 1, 3)) + rng.normal(size=(60, 3, 3)) * 0.2
    match kind:
        case "slivers":
            t = rng.uniform(size=(60, 1))
            triangles[:, 2] = (1 - t) * triangles[:, 0] + t * triangles[:, 1] + rng.normal(size=(60, 3)) * 1e-6
        case "needles":
            triangles[:, 2] = triangles[:, 1] + rng.normal(size=(60, 3)) * 1e-5
        case "segments":
            t = rng.uniform(size=(60, 1))
            triangles[:, 2] = (1 - t) * triangles[:, 0] + t * triangles[:, 1]
        case "points":
            triangles[:] = triangles[:, :1]
        case "duplicates":
            triangles[:] = triangles[:1]
        case "flat":
            triangles[..., 2] = 0.25
        case "many scales":
            triangles *= 10.0 ** rng.uniform(-6, 2, (60, 1, 1))
        case "two far bodies":
            triangles[30:] += 1000
    return triangles


@pytest.mark.parametrize(
    "kind",
    ["any", "slivers", "needles", "segments", "points", "duplicates", "flat", "many scales", "two far bodies"],
)
def test_distances_equal_brute_force(kind):
    rng = np.random.default_rng(11)
    triangles = soup(kind, rng)
    corners = triangles.reshape(-1, 3)
    points = np.concatenate([rng.normal(size=(150, 3)), corners[:30], corners[30:60] + rng.normal(size=(30, 3)) * 1e-3])
    index = SurfaceIndex(*separate(triangles))
    closest, squared, faces = index.closest(points)
    expected = brute_force(points, triangles)
    scale = np.abs(corners).max() + np.abs(points).max()
    assert np.abs(np.sqrt(squared) - expected).max() < 1e-12 * scale
    assert np.array_equal(squared, index.squared_distances(points))
    # The closest point is as far away as claimed, and lies on the face that is named.
    assert np.abs(np.linalg.norm(points - closest, axis=1) - expected).max() < 1e-12 * scale
    for face in np.unique(faces):
        own = faces == face
        assert brute_force(closest[own], triangles[face : face + 1]).max() < 1e-9 * scale


@pytest.mark.parametrize("turned", [False, True])
def test_distances_on_a_cylinder_of_long_triangles(turned):
    mesh = trimesh.creation.cylinder(0.1, 2, sections=40)
    rng = np.random.default_rng(12)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] if turned else np.eye(3)
    vertices = np.ascontiguousarray(mesh.vertices @ turn)
    points = rng.normal(size=(300, 3))
    closest, squared, _ = SurfaceIndex(vertices, mesh.faces).closest(points)
    expected = brute_force(points, vertices[mesh.faces])
    assert np.abs(np.sqrt(squared) - expected).max() < 1e-13
    assert np.abs(np.linalg.norm(points - closest, axis=1) - expected).max() < 1e-13


def test_every_size_of_tree():
    rng = np.random.default_rng(13)
    points = rng.normal(size=(50, 3))
    for count in (1, 2, 4, 5, 9, 32, 33, 34, 70, 300):
        triangles = rng.uniform(-0.5, 0.5, (count, 1, 3)) + rng.normal(size=(count, 3, 3)) * 0.1
        squared = SurfaceIndex(*separate(triangles)).squared_distances(points)
        assert np.abs(np.sqrt(squared) - brute_force(points, triangles)).max() < 1e-13


def test_surface_samples_have_no_distance():
    mesh = trimesh.creation.torus(0.3, 0.1)
    points, _ = sample_surface(mesh.vertices, mesh.faces, 5000, seed=3)
    assert SurfaceIndex(mesh.vertices, mesh.faces).squared_distances(points).max() < 1e-30


def test_distance_from_a_cube_is_known_in_closed_form():
    mesh = trimesh.creation.box((1, 1, 1))
    points = np.array([[0, 0, 0], [2, 0, 0], [1.5, 1.5, 0], [1.5, 1.5, 1.5], [0.4, 0.1, 0]])
    squared = SurfaceIndex(mesh.vertices, mesh.faces).squared_distances(points)
    assert squared == pytest.approx([0.25, 2.25, 2, 3, 0.01], abs=1e-15)


def test_many_coincident_triangles_build_and_answer():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]])
    faces = np.tile(np.array([[0, 1, 2]], dtype=np.int32), (100_000, 1))
    squared = SurfaceIndex(vertices, faces).squared_distances(np.array([[0.2, 0.2, 3.0], [-2, 0, 0]]))
    assert squared == pytest.approx([9, 4])


def test_clusters_of_ever_smaller_size_do_not_overflow_the_stack():
    # Each split by surface area can only peel off a little: the depth has to be bounded by other means.
    centres = 2.0 ** -np.arange(900.0)[:, None] * np.ones(3)
    triangles = centres[:, None] * (1 + np.eye(3) * 0.1)
    points = np.random.default_rng(14).uniform(0, 1, (40, 3))
    squared = SurfaceIndex(*separate(triangles)).squared_distances(points)
    assert np.abs(np.sqrt(squared) - brute_force(points, triangles[:200])).max() < 1e-13


def test_bound_leaves_out_what_is_far():
    mesh = trimesh.creation.icosphere(subdivisions=2)
    index = SurfaceIndex(mesh.vertices, mesh.faces)
    points = np.array([[1.05, 0, 0], [3, 0, 0]])
    closest, squared, faces = index.closest(points, bound=0.5)
    assert squared[0] == index.squared_distances(points)[0]
    assert squared[1] == np.inf
    assert np.isnan(closest[1]).all()
    assert faces[1] == -1
    assert faces[0] >= 0


def test_mean_is_exact_or_proven_too_large():
    mesh = trimesh.creation.box((1, 1, 1))
    index = SurfaceIndex(mesh.vertices, mesh.faces)
    points = np.random.default_rng(15).normal(size=(2000, 3))
    mean = index.squared_distances(points).mean()
    assert index.mean_squared_distance(points) == pytest.approx(mean, rel=1e-12)
    assert index.mean_squared_distance(points, stop_above=mean * 1.001) == pytest.approx(mean, rel=1e-12)
    assert index.mean_squared_distance(points, stop_above=mean * 0.999) == np.inf


def test_the_sum_stops_before_all_points_are_visited():
    mesh = trimesh.creation.box((1, 1, 1))
    index = SurfaceIndex(mesh.vertices, mesh.faces)
    points = np.random.default_rng(17).normal(size=(1000, 3)) + 5
    squared, lanes = np.full(1000, -1.0), np.full(1000, -1)
    order = np.arange(1000, dtype=np.int32)
    total = search(
        points, order, index.tree, np.inf, 200.0, squared, lanes,
    )  # fmt: skip
    visited = np.flatnonzero(squared >= 0)
    expected = index.squared_distances(points)
    assert np.array_equal(visited, np.arange(len(visited)))
    assert total == pytest.approx(expected[visited].sum())
    assert expected[visited[:-1]].sum() <= 200 < total  # the last point visited proved it


def test_unused_vertices_do_not_matter():
    triangle = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [np.nan, 0, 0], [np.inf, 5, 0]])
    squared = SurfaceIndex(triangle, np.array([[0, 1, 2]])).squared_distances(np.array([[0, 0, 2.0]]))
    assert squared == pytest.approx([4])


def test_queries_run_in_several_threads_at_once():
    mesh = trimesh.creation.icosphere(subdivisions=3)
    index = SurfaceIndex(mesh.vertices, mesh.faces)
    points = np.random.default_rng(16).normal(size=(4, 3000, 3))
    expected = [index.squared_distances(part) for part in points]
    results = [np.empty(0)] * 4

    def work(slot):
        results[slot] = index.squared_distances(points[slot])

    threads = [threading.Thread(target=work, args=(slot,)) for slot in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(a, b) for a, b in zip(expected, results, strict=True))


def test_threads_that_meet_a_new_tree_make_each_part_of_it_once():
    mesh = trimesh.creation.icosphere(subdivisions=5)
    points = mesh.vertices[np.random.default_rng(18).permutation(len(mesh.vertices))] * 1.01
    expected = SurfaceIndex(mesh.vertices, mesh.faces).squared_distances(points)
    for _ in range(10):
        index = SurfaceIndex(mesh.vertices, mesh.faces)
        results = [np.empty(0)] * 4

        def work(slot, index=index, results=results):
            results[slot] = index.squared_distances(points)

        threads = [threading.Thread(target=work, args=(slot,)) for slot in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert all(np.allclose(expected, result, rtol=1e-9, atol=1e-28) for result in results)
        tree = index.tree
        rows, frames = tree.row_of[tree.row_of > 0], tree.frames_of[tree.frames_of > 0]
        assert sorted(rows) == list(range(tree.upper, tree.taken[0]))
        assert sorted(frames) == list(range(1, tree.taken[1]))


def test_queries_in_a_corner_make_little_of_the_tree():
    mesh = trimesh.creation.icosphere(subdivisions=6)
    index = SurfaceIndex(mesh.vertices, mesh.faces)
    points = np.random.default_rng(19).uniform(0.5, 0.6, (2000, 3))
    triangles = mesh.vertices[mesh.faces]
    near = brute_force(points[:20], triangles[np.linalg.norm(triangles.mean(1) - 0.577, axis=1) < 0.3])
    assert np.abs(np.sqrt(index.squared_distances(points)[:20]) - near).max() < 1e-13
    tree = index.tree
    assert 0 < tree.taken[1] < 0.1 * len(tree.frames_of)
    assert 0 < tree.taken[0] - tree.upper < 0.1 * len(tree.row_of)


def test_no_faces_and_no_points_are_errors():
    with pytest.raises(ValueError, match="face"):
        SurfaceIndex(np.zeros((3, 3)), np.empty((0, 3), dtype=np.int32))
    index = SurfaceIndex(np.eye(3), np.array([[0, 1, 2]]))
    with pytest.raises(ValueError, match="point"):
        index.mean_squared_distance(np.empty((0, 3)))
    assert index.squared_distances(np.empty((0, 3))).shape == (0,)
