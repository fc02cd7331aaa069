"""The ground-truth error: squares of the difference of (n, d), families by their nearest member."""

import numpy as np
import pytest

from model.types import FloatArray
from training.evaluation.matching import FoundAxis, clear_axes_found, clear_planes_found, ground_truth_error
from training.oracle.truth import Truth, TruthAxis

X, Y, Z = np.eye(3)


def truth_of(planes: list[list[float]], axes: list[TruthAxis] | None = None, family: bool = False) -> Truth:
    rows = np.array(planes, dtype=np.float64).reshape(-1, 4)
    return Truth(np.zeros(3), 1.0, rows, np.zeros(len(rows)), np.full(len(rows), family), axes or [])


def turned(angle: float, offset: float = 0.0) -> FloatArray:
    """A plane whose normal is x turned about z by so many degrees."""
    return np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0.0, offset])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_it_is_the_squared_difference_with_the_sign_aligned(sign: float):
    truth = truth_of([[1.0, 0.0, 0.0, 0.1]])
    said = sign * turned(10.0, 0.3)
    assert ground_truth_error(truth, said) == pytest.approx(4 * np.sin(np.radians(5.0)) ** 2 + 0.04)


def test_without_a_clear_plane_there_is_none():
    truth = truth_of([[1.0, 0.0, 0.0, 0.0]])
    truth.plane_errors[:] = 1e-4
    assert ground_truth_error(truth, turned(0.0)) is None


def test_every_plane_through_a_continuous_axis_is_true():
    axis = TruthAxis(Z, np.array([0.2, 0.0, 0.0]), None, 0.0)
    truth = truth_of([[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, -0.2]], [axis], family=True)
    for angle in (0.0, 33.0, 71.0):
        plane = turned(angle)
        plane[3] = -plane[:3] @ axis.point
        assert ground_truth_error(truth, plane) == pytest.approx(0.0, abs=1e-15)
    assert ground_truth_error(truth, np.array([0.0, 0.0, 1.0, 0.0])) == pytest.approx(2.0)
    assert clear_planes_found(truth, np.array([turned(33.0, -0.2 * np.cos(np.radians(33.0)))]), 1.0, 0.01) == 1
    assert clear_planes_found(truth, np.array([[0.0, 0.0, 1.0, 0.0]]), 5.0, 0.05) == 0


def test_a_continuous_axis_without_planes_has_no_family():
    truth = truth_of([[0.0, 0.0, 1.0, 0.0]], [TruthAxis(Z, np.zeros(3), None, 0.0)])
    assert ground_truth_error(truth, turned(0.0)) == pytest.approx(2.0)


def test_every_plane_through_the_centre_of_a_sphere_is_true():
    centre = np.array([0.0, 0.1, 0.0])
    axes = [TruthAxis(direction, centre, None, 0.0) for direction in (X, Y, Z)]
    truth = truth_of([[*direction, -direction @ centre] for direction in (X, Y, Z)], axes, family=True)
    normal = np.array([2.0, 3.0, 6.0]) / 7.0
    assert ground_truth_error(truth, np.append(normal, -normal @ centre)) == pytest.approx(0.0, abs=1e-15)
    assert ground_truth_error(truth, np.append(normal, 0.2 - normal @ centre)) == pytest.approx(0.04)


def test_planes_and_axes_are_met_within_the_tolerances():
    truth = truth_of([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]], [TruthAxis(Z, np.zeros(3), 2, 0.0)])
    planes = np.array([turned(3.0), turned(90.5)])
    assert clear_planes_found(truth, planes, 1.0, 0.01) == 1
    assert clear_planes_found(truth, planes, 5.0, 0.01) == 2
    assert clear_planes_found(truth, np.array([turned(0.0, 0.03)]), 5.0, 0.01) == 0
    tilted = np.array([0.0, np.sin(np.radians(3.0)), np.cos(np.radians(3.0))])
    origin = np.zeros(3)
    assert clear_axes_found(truth, [FoundAxis(-tilted, origin, 2)], 5.0, 0.01) == 1
    assert clear_axes_found(truth, [FoundAxis(tilted, origin, 2)], 1.0, 0.01) == 0
    assert clear_axes_found(truth, [FoundAxis(Z, np.array([0.02, 0.0, 0.0]), 2)], 5.0, 0.01) == 0
