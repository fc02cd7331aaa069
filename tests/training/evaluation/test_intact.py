"""What counts as right of a group found: it holds on the intact shape, and what is tilted a little does not."""

import numpy as np
import trimesh

from model.search.hypothesis import Hypothesis
from model.search.point_groups import point_group
from training.evaluation.calibration import Group
from training.evaluation.intact import IntactShape


def group(name: str, shape: IntactShape) -> Group:
    level = Hypothesis(point_group(name), np.eye(3), np.zeros(3))
    return Group("shape", "rotated", name, (), *shape.judged(level))


def unit(mesh: trimesh.Trimesh, ratio: float = 1.0) -> IntactShape:
    vertices = mesh.vertices / (2.0 * np.linalg.norm(mesh.vertices, axis=1).max())
    return IntactShape(vertices, mesh.faces.astype(np.int32), ratio)


def test_a_box_has_its_group_and_no_larger_one() -> None:
    box = unit(trimesh.creation.box((1.0, 0.8, 0.6)))
    assert group("D2h", box).is_right(4e-4)
    assert group("D2h", box).contrast > 100.0
    assert not group("D4h", box).is_right(4e-4)


def test_of_a_lump_planes_that_hold_within_the_threshold_are_no_symmetries() -> None:
    lump = trimesh.creation.icosphere(3)
    rng = np.random.default_rng(4)
    lump.vertices *= 1.0 + 0.03 * rng.normal(size=(len(lump.vertices), 1))
    found = group("Cs", unit(lump))
    assert 1e-6 < found.error < 4e-4
    assert found.contrast < 2.0
    assert not found.is_right(4e-4)


def test_of_round_shapes_only_the_axis_is_tilted() -> None:
    for mesh, name in (
        (trimesh.creation.cylinder(1.0, 1.5, sections=64), "Dinfh"),
        (trimesh.creation.icosphere(4), "Kh"),
    ):
        found = group(name, unit(mesh))
        assert found.error < 4e-4
        assert found.is_right(4e-4)
    assert not group("Dinfh", unit(trimesh.creation.box((1.0, 0.8, 0.6)))).is_right(4e-4)


def test_the_error_is_told_in_the_intact_shapes_own_frame() -> None:
    box = trimesh.creation.box((1.0, 0.8, 0.6))
    assert np.isclose(group("C3", unit(box, 2.0)).error, 4.0 * group("C3", unit(box)).error)
