"""Finite groups: every point group is recognised in any frame, from all members or from a few."""

import numpy as np
import pytest

from model.geometry.operations import Operations
from model.search import closure
from model.search.point_groups import identify, point_group
from training.shapes.point_groups import group_elements, group_matrices
from training.shapes.solids import random_rotation

ORDERS = (2, 3, 4, 5, 6, 7, 8, 12, 24, 60)
NAMES = [
    *("C1", "Cs", "Ci", "T", "Td", "Th", "O", "Oh", "I", "Ih"),
    *(f"{kind}{n}{suffix}" for n in ORDERS for kind, suffix in (("C", ""), ("C", "v"), ("C", "h"))),
    *(f"D{n}{suffix}" for n in ORDERS for suffix in ("", "d", "h")),
    *(f"S{2 * n}" for n in ORDERS[:-1]),
]


@pytest.mark.parametrize("name", NAMES)
def test_names_and_elements_of_all_groups_in_any_frame(name: str):
    rng = np.random.default_rng(NAMES.index(name))
    frame = random_rotation(rng)
    matrices = frame @ group_matrices(name) @ frame.T
    group = closure.closure(matrices[rng.permutation(len(matrices))[:6]])
    assert group is not None
    assert closure.contains(matrices, group).all()  # nothing was made up on the way
    whole = closure.closure(matrices)
    assert whole is not None
    assert len(whole) == len(matrices)
    assert closure.name(whole, closure.elements(whole)) == name
    expected = group_elements(name)
    found = closure.elements(whole)
    assert sorted(found.orders) == sorted(expected.orders)
    for ours, theirs in ((found.normals, expected.planes), (found.directions, expected.axes)):
        assert len(ours) == len(theirs)
        if len(ours):
            assert np.abs(ours @ (theirs @ frame.T).T).max(1).min() > 1.0 - 1e-9


def test_members_that_are_a_little_off_close_all_the_same():
    rng = np.random.default_rng(1)
    matrices = group_matrices("Oh")
    chosen = matrices[rng.permutation(len(matrices))[:5]]
    exact = closure.closure(chosen)
    assert exact is not None
    assert len(exact) > len(chosen)
    wobbly = []
    for matrix in chosen:
        left, _, right = np.linalg.svd(matrix + 1e-3 * rng.normal(size=(3, 3)))
        wobbly.append(left @ right)
    group = closure.closure(np.stack(wobbly))
    assert group is not None
    assert len(group) == len(exact)
    distances = np.abs(group[:, None] - exact[None]).max((2, 3))
    assert distances.min(1).max() < 0.02
    assert distances.min(0).max() < 0.02


def test_rotations_that_fit_no_finite_group_are_given_up():
    turns = [np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]) for a in (1.0, 2.0**0.5)]
    assert closure.closure(np.stack(turns)) is None
    assert closure.closure(group_matrices("D24h"), largest=12) is None


def test_what_closes_by_chance_is_no_group() -> None:
    """With a wide tolerance some products are taken for others."""
    rng = np.random.default_rng(3)
    checked = 0
    for _ in range(300):
        directions = rng.normal(size=(2, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        angles = 2.0 * np.pi / rng.integers(2, 6, size=2)
        members = closure.closure(Operations.rotations(directions, np.zeros(3), angles).matrices, 12, np.deg2rad(12.0))
        if members is None:
            continue
        identified = identify(members, np.deg2rad(12.0))
        checked += identified is None
        assert identified is None or len(members) == point_group(identified[0]).size
    assert checked


@pytest.mark.parametrize(
    ("degrees", "name"), [(44.2, "C4v"), (46.1, "C4v"), (29.3, "C6v"), (60.9, "C3v"), (88.6, "C2v")]
)
def test_planes_near_an_angle_of_a_group_close_where_products_are_snapped(degrees: float, name: str):
    angles = np.radians([10.0, 10.0 + degrees])
    normals = np.stack([np.cos(angles), np.sin(angles), np.zeros(2)], axis=1) @ random_rotation(
        np.random.default_rng(3)
    )
    mirrors = Operations.reflections(np.column_stack([normals, np.zeros(2)])).matrices
    same = float(np.radians(3.0))
    group = closure.closure(mirrors, 12, same, snap=True)
    assert group is not None
    identified = identify(group, same)
    assert identified is not None
    assert identified[0] == name
    np.testing.assert_allclose(group @ group.transpose(0, 2, 1), np.broadcast_to(np.eye(3), group.shape), atol=1e-9)
