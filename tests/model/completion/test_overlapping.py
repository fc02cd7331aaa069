"""Cuts through several bodies: beside each other, inside each other as hollows, and overlapping."""

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from app import halve, sector
from model.completion.halving import halve as halve_at
from model.completion.sector import cut_sector
from model.formats import read_mesh
from model.geometry.transforms import rotation_matrix
from model.meshes.mesh import Mesh

TURN = rotation_matrix(np.array([2.0, -1.0, 3.0]) / np.sqrt(14.0), 0.7)
SHIFT = np.array([3.0, -5.0, 40.0])
AXIS = TURN @ np.array([0.0, 0.0, 1.0])


def prism(sides, radius, low, high, *, at=(0.0, 0.0), inward=False):
    body = trimesh.creation.cylinder(radius=radius, height=high - low, sections=sides)
    body.apply_translation([*at, (low + high) / 2.0])
    if inward:
        body.invert()
    return body


def placed(*bodies):
    """All bodies in one mesh, in general position."""
    whole = trimesh.util.concatenate(list(bodies))
    return Mesh.checked(whole.vertices @ TURN.T + SHIFT, whole.faces)


def volumes(vertices, faces):
    """The signed volume of every body, sorted."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.merge_vertices()
    return sorted(float(part.volume) for part in mesh.split(only_watertight=False))


SHAFT, DISC = prism(6, 1.0, -3.0, 5.0), prism(12, 5.0, 0.0, 1.0)
PINS = [prism(8, 0.7, -0.5, 1.5, at=(4 * np.cos(t), 4 * np.sin(t))) for t in np.pi * np.arange(6) / 3]


@pytest.mark.parametrize("order", [2, 3, 6])
def test_overlapping_bodies_are_closed_each_alone(order):
    whole = placed(SHAFT, DISC, *PINS)
    start = TURN @ np.array([1.0, 0.0, 0.0])  # through pins
    part = cut_sector(whole, AXIS, SHIFT, order, start=start)
    assert part.capped
    assert part.overlapping == 4  # the shaft, the disc and, where each of the cuts begins, a pin
    assert Mesh.checked(part.vertices, part.faces).watertight
    bodies = [SHAFT, DISC, *PINS]
    assert sum(volumes(part.vertices, part.faces)) == pytest.approx(sum(body.volume for body in bodies) / order)


def test_overlapping_bodies_that_do_not_cross_in_the_cut_are_both_whole():
    inner = trimesh.creation.box((3.5, 1, 1)).apply_translation((1.25, 0, 0))  # pokes out on one side
    outer = trimesh.creation.box((4, 4, 4))
    done = halve_at(placed(outer, inner), np.append(TURN[:, 0], -(TURN[:, 0] @ SHIFT)), positive=False, capped=True)
    assert done.capped
    assert done.overlapping == 2
    assert_allclose(volumes(done.vertices, done.faces), [0.5, 32.0])


def test_hollows_stay_hollows():
    outer, inner = trimesh.creation.box((4, 4, 4)), trimesh.creation.box((2, 2, 2))
    shaft = trimesh.creation.box((9, 1, 1)).apply_translation((0, 0, 1.6))  # overlaps the wall, not the hollow
    inner.invert()
    plane = np.append(TURN[:, 1], -(TURN[:, 1] @ SHIFT))
    alone = halve_at(placed(outer, inner), plane, capped=True)
    assert (alone.capped, alone.overlapping) == (True, 0)
    assert sum(volumes(alone.vertices, alone.faces)) == pytest.approx((64 - 8) / 2)
    assert Mesh.checked(alone.vertices, alone.faces).watertight
    both = halve_at(placed(outer, inner, shaft), plane, capped=True)
    assert (both.capped, both.overlapping) == (True, 2)
    assert sum(volumes(both.vertices, both.faces)) == pytest.approx((64 - 8 + 9) / 2)


def test_bodies_beside_each_other_are_closed_together():
    bodies = [trimesh.creation.box((1, 1, 1)).apply_translation((0, 0, 3 * k)) for k in range(4)]
    done = halve_at(placed(*bodies), np.append(TURN[:, 0], -(TURN[:, 0] @ SHIFT)), capped=True)
    assert (done.capped, done.overlapping) == (True, 0)
    assert_allclose(volumes(done.vertices, done.faces), [0.5] * 4)


def test_a_body_that_is_open_leaves_all_open():
    sheet = trimesh.Trimesh([[-5, -5, 0], [5, -5, 0.5], [5, 5, 0]], [[0, 1, 2]])
    done = halve_at(placed(DISC, sheet), np.append(TURN[:, 0], -(TURN[:, 0] @ SHIFT)), capped=True)
    assert not done.capped


def test_overlapping_bodies_are_told(tmp_path):
    trimesh.util.concatenate([SHAFT, DISC]).export(tmp_path / "a.stl")
    assert len(read_mesh((tmp_path / "a.stl").read_bytes(), "a.stl").faces) == len(SHAFT.faces) + len(DISC.faces)
    (warning,) = sector(tmp_path / "a.stl", order=6).sector.warnings
    assert "2 bodies overlap where the mesh is cut" in warning
    (warning,) = halve(tmp_path / "a.stl", capped=True).half.warnings
    assert "unite them" in warning
    assert halve(tmp_path / "a.stl").half.warnings == []
