"""Completing is near linear: what it asks about a surface grows with the faces, whatever their shapes."""

import numpy as np
import pytest

from model.completion import mirroring, missing
from model.completion.mirroring import complete
from model.completion.missing import find_missing
from model.errors import TooComplexError
from model.geometry.frames import triangle_areas
from model.geometry.surface import SurfaceIndex
from model.geometry.topology import connected_parts, occurs_once
from model.meshes.mesh import Mesh


def prism(corners):
    """Its caps are fans of slivers from one corner each."""
    angle = 2.0 * np.pi * np.arange(corners) / corners
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    vertices = np.concatenate([np.column_stack([ring, np.full(corners, z)]) for z in (-0.5, 0.5)])
    here, cap = np.arange(corners), np.arange(1, corners - 1)
    after = (here + 1) % corners
    sides = [np.stack([here, after, after + corners], 1), np.stack([here, after + corners, here + corners], 1)]
    caps = [np.stack([0 * cap, cap + 1, cap], 1), np.stack([0 * cap, cap, cap + 1], 1) + corners]
    return Mesh.checked(vertices, np.concatenate([*sides, *caps]).astype(np.int32))


@pytest.fixture
def spent(monkeypatch):
    """The work of every surface index that completing makes."""
    made = []

    class Counted(SurfaceIndex):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            made.append((self, self.work_left))

    monkeypatch.setattr(mirroring, "SurfaceIndex", Counted)
    return lambda: sum(before - index.work_left for index, before in made)


@pytest.mark.parametrize("symmetrize", [False, True])
@pytest.mark.parametrize("normal", [[0.0, 0.0, 1.0], [0.6, 0.8, 0.0]])
def test_work_grows_with_the_faces_of_fans(spent, normal, symmetrize):
    small, large = prism(500), prism(4000)
    complete(small, np.array([*normal, 0.0]), symmetrize=symmetrize)
    first = spent()
    done = complete(large, np.array([*normal, 0.0]), symmetrize=symmetrize)
    assert spent() - first < 20 * first
    assert spent() - first < 300 * len(large.faces)
    assert done.area_added < 1e-9


def test_where_the_mesh_is_its_own_mirror_image_nothing_is_measured(spent):
    """Nothing but the samples that tell the error and the tolerance."""
    many = prism(6000)
    assert complete(many, np.array([0.0, 0.0, 1.0, 0.0])).faces_kept == len(many.faces)
    assert spent() < 18 * len(many.faces)  # by samples alone 6; the sides' diagonals are no mirror images


@pytest.mark.parametrize("distance", [1e-4, 0.02, 0.3])
def test_the_border_is_where_the_distance_is_that_of_the_tolerance(distance, spent):
    """Between points beyond it and points within it, in few questions, past edges and corners too."""
    mesh = prism(7)
    surface = mirroring.SurfaceIndex(mesh.vertices, mesh.faces)
    chance = np.random.default_rng(0)
    far = chance.normal(size=(3000, 3))
    far *= (chance.uniform(2.0, 4.0, (3000, 1))) / np.linalg.norm(far, axis=1, keepdims=True)
    near = mesh.vertices[mesh.faces[chance.integers(len(mesh.faces), size=3000)]]
    near = (near * chance.dirichlet(np.ones(3), 3000)[:, :, None]).sum(axis=1)
    near[:7] = mesh.vertices[:7]
    work = spent()
    found = missing._at_distance(surface, far, near, distance)
    asked = spent() - work
    assert np.abs(np.sqrt(surface.squared_distances(found)) - distance).max() < 1e-8
    share = ((found - far) * (near - far)).sum(axis=1) / ((near - far) ** 2).sum(axis=1)
    assert np.abs(found - (far + share[:, None] * (near - far))).max() < 1e-12
    assert ((share > 0.0) & (share < 1.0)).all()
    surface.squared_distances(found)
    assert asked < 12 * (spent() - work - asked) / 2  # bisection takes 30


def test_edges_that_belong_to_one_face_are_told():
    """Numbers that are equal to no other, collisions of the hash table among them."""
    numbers = np.random.default_rng(1).integers(0, 3000, 5000)
    values, counts = np.unique(numbers, return_counts=True)
    np.testing.assert_array_equal(occurs_once(numbers), np.isin(numbers, values[counts == 1]))
    assert occurs_once(np.empty(0, dtype=np.int64)).shape == (0,)


def test_a_face_that_lacks_its_mirror_image_is_found_among_thousands_that_have_it():
    mesh = prism(3000)
    cap = np.flatnonzero((mesh.vertices[mesh.faces][:, :, 2] > 0.0).all(1))
    done = complete(Mesh.checked(mesh.vertices, np.delete(mesh.faces, cap, axis=0)), np.array([0.0, 0.0, 1.0, 0.0]))
    assert np.isclose(triangle_areas(done.vertices[done.faces]).sum(), mesh.area, rtol=1e-3)


def test_parts_are_told_apart_however_long_the_way_through_one_is():
    count = 200_000
    corner = np.random.default_rng(0).permutation(2 * count).astype(np.int32)
    strip = np.stack([np.arange(count - 2), np.arange(1, count - 1), np.arange(2, count)], axis=1)
    faces = np.concatenate([corner[strip], corner[strip + count]])
    parts = np.empty(2 * count, dtype=np.int32)
    connected_parts(np.ascontiguousarray(faces.astype(np.int32)), parts)
    assert len(set(parts[corner[:count]].tolist())) == len(set(parts[corner[count:]].tolist())) == 1
    assert parts[corner[0]] != parts[corner[count]]


def test_slivers_are_not_cut_without_end(monkeypatch):
    monkeypatch.setattr(missing, "_MOST_FACES", 100)
    monkeypatch.setattr(missing, "_FACES_A_FACE", 1)
    mesh = prism(5000)
    surface = SurfaceIndex(mesh.vertices, mesh.faces, work=1e9)
    normal = np.array([0.02, 0.0, 1.0]) / np.linalg.norm([0.02, 0.0, 1.0])
    mirrored = mesh.vertices - 2.0 * np.outer(mesh.vertices @ normal, normal)
    with pytest.raises(TooComplexError, match="triangles"):
        find_missing(surface, mesh.vertices, mirrored, mesh.faces[:, ::-1], 1e-4)


def test_one_far_vertex_makes_a_large_share_of_area_and_no_failure():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1e12, 0, 0]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3], [0, 1, 4], [1, 2, 4]])
    normal = np.array([0.3, 0.2, 1.0]) / np.linalg.norm([0.3, 0.2, 1.0])
    done = complete(Mesh.checked(vertices, faces), np.append(normal, 0.0))
    assert np.isfinite(done.area_added)
    assert done.area_added > 0.0
