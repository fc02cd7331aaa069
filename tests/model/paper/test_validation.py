"""The paper's validation on shapes whose answers are known."""

import numpy as np
import pytest

from model.geometry.frames import UnitFrame
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.meshes.mesh import Mesh
from model.paper.validation import MAX_ERROR, Judged, sweep, validate_axes, validate_planes
from model.types import FloatArray
from tests.shapes import as_mesh, box, known


def unit(mesh: Mesh) -> tuple[SurfaceIndex, FloatArray]:
    vertices = UnitFrame.of(mesh.vertices, mesh.faces).to_unit(mesh.vertices)
    return SurfaceIndex(vertices, mesh.faces), sample_surface(vertices, mesh.faces, 1000, seed=0)[0]


def plane(*normal: float, offset: float = 0.0) -> FloatArray:
    direction = np.array(normal)
    return np.append(direction / np.linalg.norm(direction), offset)


def reasons(judged: list[Judged]) -> list[str | None]:
    return [item.reason for item in judged]


def test_the_planes_of_a_box_are_accepted_with_no_error():
    surface, samples = unit(box())
    judged = validate_planes(np.eye(3, 4), surface, samples)
    assert reasons(judged) == [None, None, None]
    assert max(item.error for item in judged) < 1e-25


def test_a_plane_that_is_none_is_rejected_and_sorted_last():
    surface, samples = unit(box())
    judged = validate_planes(np.stack([plane(1, 1, 1), plane(0, 0, 1)]), surface, samples)
    assert reasons(judged) == [None, "not_symmetric"]
    assert judged[0].error < 1e-25
    assert judged[1].error > MAX_ERROR


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_of_two_close_planes_the_worse_goes_whatever_its_sign(sign: float):
    surface, samples = unit(box())
    tilted = sign * plane(0.02, 0.0, 1.0)
    judged = validate_planes(np.stack([tilted, plane(0, 0, 1)]), surface, samples)
    assert reasons(judged) == [None, "duplicate"]
    np.testing.assert_array_equal(judged[0].vector, plane(0, 0, 1))


def test_the_dihedral_limit_is_thirty_degrees():
    surface, samples = unit(as_mesh(known("sphere")))
    for degrees, expected in ((29.0, "duplicate"), (31.0, None)):
        angle = np.deg2rad(degrees)
        judged = validate_planes(np.stack([plane(1, 0, 0), plane(np.cos(angle), np.sin(angle), 0)]), surface, samples)
        assert reasons(judged) == [None, expected]


def test_the_threshold_is_the_callers():
    surface, samples = unit(box())
    shifted = plane(0, 0, 1, offset=0.005)
    assert reasons(validate_planes(shifted[None], surface, samples)) == [None]
    assert reasons(validate_planes(shifted[None], surface, samples, max_error=1e-6)) == ["not_symmetric"]


def test_the_axis_of_a_cylinder_holds_for_every_degree():
    shape = known("cylinder")
    surface, samples = unit(as_mesh(shape))
    direction = shape.axes[0].direction
    judged = validate_axes(direction[None], np.array([np.pi]), surface, samples)
    assert reasons(judged) == [None]
    assert judged[0].error < MAX_ERROR


def test_a_prism_is_no_surface_of_revolution():
    shape = known("prism", n=4)
    direction = max(shape.axes, key=lambda axis: axis.order or 0).direction
    surface, samples = unit(as_mesh(shape))
    judged = validate_axes(np.stack([direction]), np.array([np.pi]), surface, samples)
    assert reasons(judged) == ["not_continuous"]
    assert judged[0].error > MAX_ERROR


def test_a_rotation_that_is_no_symmetry_is_rejected_as_such():
    surface, samples = unit(box())
    judged = validate_axes(np.eye(3)[:1], np.array([np.pi / 2]), surface, samples)
    assert reasons(judged) == ["not_symmetric"]


def test_the_sweep_reports_its_worst_angle():
    """A 24-gon prism keeps its symmetry at multiples of 15 degrees and is worst half-way between them."""
    shape = known("prism", n=24)
    surface, samples = unit(as_mesh(shape))
    direction = max(shape.axes, key=lambda axis: axis.order or 0).direction
    worst, holds = sweep(direction, surface, samples, max_error=1.0)
    assert holds
    from model.geometry.transforms import rotation_matrix

    errors = [
        surface.mean_squared_distance(samples @ rotation_matrix(direction, np.deg2rad(k)).T) for k in range(1, 360)
    ]
    assert worst == pytest.approx(max(errors), rel=1e-12)
    tight, held = sweep(direction, surface, samples, max_error=worst / 2)
    assert not held
    assert tight > worst / 2
