"""Congruent, mirror images or neither: shapes of which it is known, in any place and pose."""

import numpy as np
import pytest
import trimesh

from model.comparison.twins import compare
from model.meshes.mesh import Mesh


def fan(lean: float, blades: int = 5) -> Mesh:
    """A hub with blades that lean to one side: its group is Cn, and it has a twin that is not itself."""
    hub = trimesh.creation.cylinder(3, 4, sections=40)
    parts = [hub]
    for blade in range(blades):
        part = trimesh.creation.box((6, 2.0, 0.4))
        part.apply_transform(trimesh.transformations.rotation_matrix(lean, [1, 0, 0]))
        part.apply_translation([6, 0, 0.5])
        part.apply_transform(trimesh.transformations.rotation_matrix(2 * np.pi * blade / blades, [0, 0, 1]))
        parts.append(part)
    joined = trimesh.util.concatenate(parts)
    return Mesh.checked(joined.vertices, joined.faces)


def wedge() -> Mesh:
    """A solid without any symmetry."""
    points = np.array([[0, 0, 0], [5, 0, 0], [0, 3, 0], [1, 0.5, 2], [2, 2, 0.5]], dtype=float)
    hull = trimesh.convex.convex_hull(points)
    return Mesh.checked(hull.vertices, hull.faces)


def moved(mesh: Mesh, seed: int, mirror: bool = False) -> tuple[Mesh, np.ndarray]:
    """The mesh in another pose and place, its vertices in another order; and the (4, 4) motion."""
    rng = np.random.default_rng(seed)
    matrix = trimesh.transformations.random_rotation_matrix(rng.random(3))
    if mirror:
        matrix = matrix @ np.diag([1.0, -1.0, 1.0, 1.0])
    matrix[:3, 3] = rng.normal(size=3) * 100
    order = rng.permutation(len(mesh.vertices))
    vertices = mesh.vertices[order] @ matrix[:3, :3].T + matrix[:3, 3]
    faces = np.argsort(order)[mesh.faces]
    return Mesh.checked(vertices, faces[:, ::-1] if mirror else faces), matrix


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("shape", [fan(0.6), wedge()], ids=["fan", "wedge"])
def test_a_chiral_part_is_told_from_its_twin(shape, mirror):
    other, _ = moved(shape, 3, mirror)
    found = compare(shape, other)
    assert found.relation == ("mirror_images" if mirror else "congruent")
    good, bad = (found.mirrored, found.direct) if mirror else (found.direct, found.mirrored)
    assert good.deviation < 1e-7
    assert bad.deviation > 10 * found.tolerance
    assert np.linalg.det(good.matrix[:3, :3]) == pytest.approx(-1 if mirror else 1)
    laid = shape.vertices @ good.matrix[:3, :3].T + good.matrix[:3, 3]
    nearest = np.linalg.norm(laid[:, None] - other.vertices[None], axis=2).min(axis=1)
    assert nearest.max() < 1e-6


def test_the_matrix_of_a_part_without_symmetry_is_the_motion():
    other, matrix = moved(wedge(), 9)
    assert compare(wedge(), other).direct.matrix == pytest.approx(matrix, abs=1e-6)


def test_a_part_with_a_mirror_plane_is_both():
    box = trimesh.creation.box((1, 2, 3))
    shape = Mesh.checked(box.vertices, box.faces)
    assert compare(shape, moved(shape, 5, mirror=True)[0]).relation == "both"


def test_other_parts_and_other_sizes_are_neither():
    bigger = Mesh.checked(fan(0.6).vertices * 1.02, fan(0.6).faces)
    for other in (wedge(), fan(0.6, blades=6), bigger):
        assert compare(fan(0.6), moved(other, 1)[0]).relation == "neither"


def test_what_is_the_same_is_a_matter_of_the_tolerance():
    rough = fan(0.6)
    bent = Mesh.checked(rough.vertices + np.random.default_rng(2).normal(size=rough.vertices.shape) * 0.02, rough.faces)
    other = moved(bent, 4)[0]
    assert compare(rough, other).relation == "neither"
    found = compare(rough, other, tolerance=0.2)
    assert found.relation == "congruent"
    assert 0.01 < found.direct.deviation < 0.2
