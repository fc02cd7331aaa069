"""What queries cost is bounded and counted: surfaces on which no tree prunes, duplicates, planes full of slivers."""

import numpy as np
import pytest

from model.errors import TooComplexError
from model.geometry._bvh_references import references
from model.geometry.operations import Operations
from model.geometry.refinement import refine_planes, squared_distances
from model.geometry.sampling import sample_surface
from model.geometry.surface import WORK, SurfaceIndex
from model.geometry.topology import distinct_faces, duplicate_vertex_map


def crossing(faces, vertices=120, seed=0):
    """Random triangles between few points: each goes through the whole volume."""
    rng = np.random.default_rng(seed)
    corners = np.array([rng.choice(vertices, 3, replace=False) for _ in range(faces)], dtype=np.int32)
    return rng.uniform(-0.5, 0.5, (vertices, 3)), corners


def slivers(count):
    """Long thin triangles in all directions."""
    rng = np.random.default_rng(3)
    ends = rng.uniform(-0.5, 0.5, (count, 2, 3))
    triangles = np.concatenate([ends, ends[:, :1] + 1e-4 * rng.normal(size=(count, 1, 3))], axis=1)
    return triangles.reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def fan(count):
    """A regular polygon as triangles from its first corner, in a plane that is tilted."""
    angles = 2.0 * np.pi * np.arange(count) / count
    first, second = np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.0])
    vertices = 0.5 * (np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second)
    corner = np.arange(1, count - 1)
    return vertices, np.stack([0 * corner, corner, corner + 1], axis=1).astype(np.int32)


def work_per_query(index, points):
    before = index.work_left
    index.squared_distances(points)
    return (before - index.work_left) / len(points)


def test_crossing_triangles_and_slivers_cost_a_small_part_of_looking_into_all():
    rng = np.random.default_rng(1)
    for (vertices, faces), most in ((crossing(1000), 200), (crossing(10_000), 900), (slivers(20_000), 700)):
        samples = sample_surface(vertices, faces, 300, seed=0)[0] * [-1.0, 1.0, 1.0] + 0.01 * rng.normal(size=3)
        assert work_per_query(SurfaceIndex(vertices, faces), samples) < most


def test_parts_of_cut_triangles_answer_as_whole_ones_do():
    vertices, faces = crossing(400)
    boxes, owners = references(vertices, faces)
    assert len(boxes) > 2 * len(faces)
    assert set(owners.tolist()) == set(range(len(faces)))
    points = np.random.default_rng(2).uniform(-0.7, 0.7, (500, 3))
    index = SurfaceIndex(vertices, faces)
    closest, squared, found = index.closest(points)
    alone = np.min([SurfaceIndex(vertices, faces[[face]]).squared_distances(points) for face in range(len(faces))], 0)
    assert np.allclose(squared, alone, rtol=1e-12, atol=1e-28)
    for point, face, distance in zip(closest[:50], found[:50], squared[:50], strict=True):
        assert SurfaceIndex(vertices, faces[[face]]).squared_distances(point[None])[0] < 1e-30
        assert distance >= 0.0
    assert np.array_equal(index.within(points, 0.02), squared <= 0.02**2)


def test_boxes_cover_every_part_of_their_triangles():
    vertices, faces = slivers(300)
    boxes, owners = references(vertices, faces)
    points, on = sample_surface(vertices, faces, 5000, seed=4)
    inside = np.zeros(len(points), dtype=bool)
    for box, owner in zip(boxes, owners, strict=True):
        mine = on == owner
        inside[mine] |= ((points[mine] >= box[:3] - 1e-14) & (points[mine] <= box[3:] + 1e-14)).all(1)
    assert inside.all()


def waves():
    """An ordinary surface."""
    grid = np.linspace(-0.5, 0.5, 60)
    x, y = np.meshgrid(grid, grid, indexing="ij")
    vertices = np.stack([x, y, 0.2 * np.sin(4 * x) * np.cos(3 * y)], axis=2).reshape(-1, 3)
    corner = (np.arange(59)[:, None] * 60 + np.arange(59)).ravel()
    faces = [np.stack([corner, corner + 60, corner + 61], 1), np.stack([corner, corner + 61, corner + 1], 1)]
    return vertices, np.concatenate(faces).astype(np.int32)


def test_ordinary_meshes_are_not_cut():
    vertices, faces = waves()
    assert len(references(vertices, faces)[0]) == len(faces)


def test_identical_faces_count_once():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    many = np.tile(corners, (20_000, 1)), np.arange(60_000, dtype=np.int32).reshape(-1, 3)
    points = np.random.default_rng(0).normal(size=(200, 3))
    index = SurfaceIndex(*many)
    assert work_per_query(index, points) <= 3
    once = SurfaceIndex(corners, np.array([[0, 1, 2]], dtype=np.int32))
    assert np.allclose(index.squared_distances(points), once.squared_distances(points), rtol=1e-12)
    turned = np.array([[0, 1, 2], [1, 2, 0], [2, 1, 0], [0, 1, 3]], dtype=np.int32)
    places = np.arange(4, dtype=np.int32)
    assert distinct_faces(places, turned).tolist() == [True, False, False, True]


def test_points_in_a_plane_of_slivers_do_not_look_into_all_of_them():
    vertices, faces = fan(20_000)
    samples, _ = sample_surface(vertices, faces, 500, seed=0)
    index = SurfaceIndex(vertices, faces)
    assert index.within(samples, 1e-4).all()
    assert work_per_query(index, samples + np.array([0.08, 0.0, -0.06])) < 1000


@pytest.mark.parametrize(
    "measure",
    [
        lambda index, samples: index.squared_distances(samples),
        lambda index, samples: index.closest(samples),
        lambda index, samples: index.mean_squared_distance(samples),
        lambda index, samples: index.within(samples * [-1.0, 1.0, 1.0] + 0.02, 1e-7),
        lambda index, samples: refine_planes(index, samples, np.array([[1.0, 0.0, 0.0, 0.1]])),
        lambda index, samples: squared_distances(index, samples, Operations.reflections(np.array([[1.0, 0, 0, 0.1]]))),
    ],
)
def test_whatever_measures_stops_when_the_work_is_used_up(measure):
    vertices, faces = crossing(1000)
    samples, _ = sample_surface(vertices, faces, 200, seed=0)
    measure(SurfaceIndex(vertices, faces), samples)
    index = SurfaceIndex(vertices, faces, work=300)
    with pytest.raises(TooComplexError):
        measure(index, samples)
    assert index.work_left > -5000  # it stopped, rather than finding out in the end


def asked_until_refused(index, samples):
    """How many points could be measured, a few at a time, before the index would not go on."""
    measured = 0
    for start in range(0, 1_000_000, 50):
        at = start % len(samples)
        try:
            index.squared_distances(samples[at : at + 50])
        except TooComplexError:
            break
        measured += 50
    return measured


@pytest.mark.parametrize(("vertices", "faces"), [crossing(10_000), slivers(20_000), fan(60_000)])
def test_where_every_query_costs_much_few_are_answered(vertices, faces):
    """A search that would not end is refused long before it has used up all work."""
    samples = sample_surface(vertices, faces, 4000, seed=0)[0] * [-1.0, 1.0, 1.0] + [0.01, 0.02, -0.01]
    measured = asked_until_refused(SurfaceIndex(vertices, faces), samples)
    one = work_per_query(SurfaceIndex(vertices, faces, work=1e15), samples[:300])
    assert 0.1 * WORK < one * measured < 0.4 * WORK
    unlimited = SurfaceIndex(vertices, faces, work=np.inf)
    for _ in range(3):
        unlimited.squared_distances(samples)


def test_many_cheap_queries_may_use_all_work():
    vertices, faces = waves()
    samples, _ = sample_surface(vertices, faces, 2000, seed=0)
    index = SurfaceIndex(vertices, faces, work=100_000)
    assert asked_until_refused(index, samples) > 1000
    assert -10_000 < index.work_left <= 0.0


def test_the_same_queries_cost_the_same():
    vertices, faces = crossing(500)
    samples, _ = sample_surface(vertices, faces, 200, seed=0)
    first, second = (SurfaceIndex(vertices, faces) for _ in range(2))
    first.squared_distances(samples)
    second.squared_distances(samples)
    assert first.work_left == second.work_left < WORK


@pytest.mark.timeout(60)
def test_vertices_made_to_collide_in_a_hash_table_of_known_constants_do_not():
    """Some hundred thousand of them took minutes with a table that everybody could compute."""
    mask = (1 << 64) - 1
    x = np.random.default_rng(0).uniform(1.0, 2.0, 1_000_000)
    bits = x.view(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    y = ((bits ^ np.uint64(0x1234567)) * np.uint64(pow(0xC2B2AE3D27D4EB4F, -1, 1 << 64) & mask)).view(np.float64)
    fine = (np.abs(y) < 1e60) & (np.abs(y) > 1e-60)
    vertices = np.column_stack([x, y, np.zeros(len(x))])[fine]
    assert len(vertices) > 100_000
    assert np.array_equal(duplicate_vertex_map(vertices), np.arange(len(vertices)))
