"""Matching: tolerances, continuous families, spheres, orders; what a detector may say and what it may not."""

import numpy as np
import pytest

from model.geometry.transforms import rotation_matrix
from model.types import FloatArray
from training.evaluation.matching import Found, FoundAxis, clear, match, matched_once
from training.oracle.truth import Truth, TruthAxis

X, Y, Z = np.eye(3)
NOWHERE = np.zeros((0, 4))
CENTRE = np.zeros(3)


def truth_of(planes: FloatArray, axes: list[TruthAxis] | None = None, continuous: list[bool] | None = None) -> Truth:
    rows = np.asarray(planes, dtype=np.float64).reshape(-1, 4)
    flags = np.array(continuous if continuous is not None else [False] * len(rows), dtype=np.bool_)
    return Truth(np.zeros(3), 1.0, rows, np.full(len(rows), 1e-9), flags, axes or [])


def axis(direction: FloatArray, order: int | None, point: FloatArray = CENTRE) -> TruthAxis:
    return TruthAxis(direction, point, order, 1e-9)


def returned(direction: FloatArray, order: int | None, point: FloatArray = CENTRE) -> FoundAxis:
    return FoundAxis(direction, point, order)


def plane(normal: FloatArray, offset: float = 0.0) -> FloatArray:
    return np.append(normal, offset)


def turned(vector: FloatArray, degrees: float, about: FloatArray = Z) -> FloatArray:
    return rotation_matrix(about, np.deg2rad(degrees)) @ vector


CYLINDER = truth_of([plane(Z), plane(turned(X, 20.0)), plane(turned(Y, 20.0))], [axis(Z, None)], [False, True, True])
SPHERE = truth_of([plane(X), plane(Y), plane(Z)], [axis(X, None), axis(Y, None), axis(Z, None)], [True] * 3)


@pytest.mark.parametrize(
    ("degrees", "shift", "found"),
    [(0.0, 0.0, True), (0.5, 0.0, True), (2.0, 0.0, False), (0.0, 0.005, True), (0.0, 0.02, False)],
)
def test_a_plane_is_found_within_the_tolerances(degrees: float, shift: float, found: bool):
    said = plane(turned(X, degrees), 0.1 + shift)
    for answer in (said, -said):  # normals have no sign
        result = match(truth_of(plane(X, 0.1)), Found(answer[None]))
        assert result.planes.tolist() == result.true_planes.tolist() == [found]
        if found:
            assert result.angles[0] == pytest.approx(degrees, abs=1e-9)
        else:
            assert np.isnan(result.angles[0])


def test_small_angles_are_not_lost_to_rounding():
    result = match(truth_of(plane(X)), Found(plane(turned(X, 1e-7))[None]))
    assert result.angles[0] == pytest.approx(1e-7, rel=1e-3)


def test_the_sign_of_the_offset_counts():
    assert not match(truth_of(plane(X, 0.1)), Found(plane(X, -0.1)[None])).planes.any()


@pytest.mark.parametrize(
    ("direction", "point", "order", "found", "right"),
    [
        (turned(Z, 0.5, X), CENTRE, 4, True, True),
        (-Z, CENTRE, 4, True, True),
        (Z, 3.0 * Z, 4, True, True),  # any point of the line will do
        (Z, CENTRE, 2, True, False),
        (Z, CENTRE, None, True, False),
        (turned(Z, 2.0, X), CENTRE, 4, False, False),
        (Z, 0.02 * X, 4, False, False),
    ],
)
def test_an_axis_is_found_by_its_line_and_its_order_told_apart(
    direction: FloatArray, point: FloatArray, order: int | None, found: bool, right: bool
):
    result = match(truth_of(NOWHERE, [axis(Z, 4)]), Found(NOWHERE, [returned(direction, order, point)]))
    assert result.axes.tolist() == result.true_axes.tolist() == [found]
    assert result.orders.tolist() == [right]


def test_a_continuous_axis_needs_a_continuous_answer():
    assert not match(CYLINDER, Found(NOWHERE, [returned(Z, 12)])).axes.any()
    assert match(CYLINDER, Found(NOWHERE, [returned(Z, None)])).axes.all()


def test_a_continuous_axis_finds_all_planes_through_it_and_not_the_one_across():
    result = match(CYLINDER, Found(NOWHERE, [returned(turned(Z, 0.3, X), None)]))
    assert result.planes.tolist() == [False, True, True]
    assert 0.0 < np.nanmax(result.angles) <= 0.3 + 1e-9
    assert not match(CYLINDER, Found(NOWHERE, [returned(turned(Z, 4.0, X), None)])).planes.any()
    assert not match(CYLINDER, Found(NOWHERE, [returned(Z, None, 0.05 * X + 0.05 * Y)])).planes.any()


def test_other_members_of_a_family_are_as_good_each_counted_once():
    members = [plane(turned(X, angle)) for angle in (50.0, 77.0, 140.0)]
    for count, found in ((0, 0), (1, 1), (2, 2), (3, 2)):
        result = match(CYLINDER, Found(np.array(members[:count]).reshape(-1, 4)))
        assert result.planes.tolist() == [False, found > 0, found > 1]
        assert result.true_planes.all()
    beside = match(CYLINDER, Found(plane(turned(X, 50.0), 0.02)[None]))
    assert not beside.planes.any()
    assert not beside.true_planes.any()


def test_a_sphere_does_not_care_which_planes_and_axes_are_named():
    frame = rotation_matrix(np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0), 1.0)
    planes = np.column_stack([frame, np.zeros(3)])
    whole = match(SPHERE, Found(planes, [returned(row, None) for row in frame]))
    assert whole.planes.all()
    assert whole.orders.all()
    assert whole.true_planes.all()
    assert whole.true_axes.all()
    assert match(SPHERE, Found(planes[:2])).planes.sum() == 2
    one = match(SPHERE, Found(NOWHERE, [returned(frame[0], None)]))
    assert one.planes.all()  # a family through one axis is more than three planes
    assert one.axes.sum() == 1
    beside = match(SPHERE, Found(NOWHERE, [returned(frame[0], None, 0.05 * frame[1])]))
    assert not beside.axes.any()
    assert not beside.true_axes.any()


def test_a_sphere_said_of_a_cube_finds_its_planes_but_no_order():
    cube = truth_of([plane(X), plane(Y)], [axis(X, 4), axis(turned(X, 45.0), 2)])
    frame = rotation_matrix(np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0), 1.0)
    result = match(cube, Found(NOWHERE, [returned(row, None) for row in frame]))
    assert result.planes.all()
    assert result.axes.all()
    assert not result.orders.any()
    assert not result.true_axes.any()


def test_two_fold_axes_across_a_cylinder_are_true_across_a_cone_not():
    cone = truth_of([plane(X), plane(Y)], [axis(Z, None)], [True, True])
    answer = Found(NOWHERE, [returned(turned(X, 33.0), 2), returned(turned(X, 33.0), 3)])
    assert match(CYLINDER, answer).true_axes.tolist() == [True, False]
    assert match(cone, answer).true_axes.tolist() == [False, False]


def test_a_continuous_axis_and_a_plane_across_say_the_two_fold_axes_in_it():
    washer = truth_of([plane(Z)], [axis(Z, 18), axis(X, 2), axis(Y, 3)])
    result = match(washer, Found(plane(Z)[None], [returned(Z, None)]))
    assert result.axes.tolist() == [True, True, False]
    assert result.orders.tolist() == [False, True, False]
    assert not match(washer, Found(NOWHERE, [returned(Z, None)])).axes[1]
    assert not match(washer, Found(plane(Z, 0.02)[None], [returned(Z, None)])).axes[1]


def test_clear_keeps_what_is_exact_only():
    rows = np.array([plane(X), plane(Y)])
    truth = Truth(np.zeros(3), 1.0, rows, np.array([1e-9, 1e-5]), np.zeros(2, dtype=np.bool_), [
        TruthAxis(Z, CENTRE, 2, 1e-5), TruthAxis(X, CENTRE, 2, 1e-8),
    ])  # fmt: skip
    kept = clear(truth)
    np.testing.assert_array_equal(kept.planes, rows[:1])
    assert [found.direction.tolist() for found in kept.axes] == [X.tolist()]


def test_nothing_against_nothing():
    result = match(truth_of(NOWHERE), Found(NOWHERE))
    assert result.planes.shape == result.axes.shape == result.true_planes.shape == (0,)


def test_a_plane_returned_twice_is_right_once_and_every_member_of_a_family():
    truth = truth_of([plane(X), plane(Y)])
    answer = Found(np.array([plane(X), plane(X), plane(turned(X, 45.0)), plane(Y)]))
    assert matched_once(truth, answer, match(truth, answer).true_planes) == [True, False, False, True]
    family = Found(np.array([plane(turned(X, angle)) for angle in (10.0, 50.0, 70.0)]))
    assert matched_once(CYLINDER, family, match(CYLINDER, family).true_planes) == [True] * 3
