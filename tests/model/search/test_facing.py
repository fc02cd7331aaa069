"""Which planes stand for all through a continuous axis, and which rotations tell most of a group."""

import numpy as np
import pytest

from model.geometry.operations import Operations
from model.geometry.transforms import rotation_matrix
from model.search.hypothesis import Hypothesis
from model.search.levels import facing_best_plane
from model.search.point_groups import point_group
from model.search.settings import DEFAULT
from model.search.tilting import tilted

TURNED = rotation_matrix(np.array([0.6, 0.0, 0.8]), 0.7)
CENTRE = np.array([0.02, -0.01, 0.03])


def through(normal: np.ndarray) -> np.ndarray:
    return np.append(normal, -normal @ CENTRE)


@pytest.mark.parametrize("name", ["Cinfv", "Dinfh"])
def test_a_round_group_faces_the_best_plane_through_its_axis(name: str) -> None:
    level = Hypothesis(point_group(name), TURNED, CENTRE)
    side = np.cos(0.4) * TURNED[0] + np.sin(0.4) * TURNED[1]
    worse = np.cos(1.3) * TURNED[0] + np.sin(1.3) * TURNED[1]
    beside = through(side) + np.array([0.0, 0.0, 0.0, 0.1])
    candidates = Operations.reflections(np.array([through(worse), through(side), through(TURNED[2]), beside]))
    faced = facing_best_plane(level, candidates, np.array([0.01, 0.002, 0.0, 0.0]), DEFAULT)
    assert np.allclose(np.abs(faced.planes[0, :3] @ side), 1.0)
    assert np.allclose(faced.axis, level.axis)
    assert faced.contains(level.generators, 1e-6, 1e-6).all()


def test_other_groups_and_other_planes_turn_nothing() -> None:
    finite = Hypothesis(point_group("C4v"), TURNED, CENTRE)
    planes = Operations.reflections(np.array([through(TURNED[0])]))
    assert facing_best_plane(finite, planes, np.zeros(1), DEFAULT) is finite
    level = Hypothesis(point_group("Cinfv"), TURNED, CENTRE)
    across = Operations.reflections(np.array([through(TURNED[2])]))
    assert facing_best_plane(level, across, np.zeros(1), DEFAULT) is level


@pytest.mark.parametrize("name", ["C2", "C4", "C5", "C6v", "D23h", "S6", "Oh", "I", "Ci", "Cs"])
def test_telling_rotations_are_large_and_generate_what_the_generators_do(name: str) -> None:
    level = Hypothesis(point_group(name), TURNED, CENTRE)
    assert level.contains(level.telling, 1e-6, 1e-6).all()
    for small, large in zip(level.generators.angles, level.telling.angles, strict=True):
        if small > 0.0:
            order = round(2.0 * np.pi / small)
            assert large == pytest.approx(small * round(large / small))
            assert np.gcd(round(large / small), order) == 1
            assert order <= 6 or large > 0.7 * np.pi


def test_what_lies_across_an_axis_is_tilted_towards_it_alone() -> None:
    level = Hypothesis(point_group("D30h"), TURNED, CENTRE)
    plane = Operations.reflections(level.planes[:1])
    angle = np.deg2rad(12.0)
    assert len(tilted(plane, angle)) == 8
    towards = tilted(plane, angle, level.turning_axis)
    assert len(towards) == 2
    assert not level.contains(towards, np.deg2rad(5.0), 1.0).any()
    assert np.allclose(np.abs(towards.directions @ level.axis), np.sin(angle))
