"""The diameter of point sets, against every pair."""

import numpy as np
import pytest

from model.geometry.diameter import diameter


@pytest.mark.parametrize("count", [1, 2, 50, 700])
@pytest.mark.parametrize("stretch", [(1.0, 1.0, 1.0), (1.0, 3.0, 0.2), (0.0, 0.0, 1.0)])
def test_it_is_the_longest_of_all_pairs(count: int, stretch: tuple[float, float, float]) -> None:
    points = np.random.default_rng(count).normal(size=(count, 3)) * stretch + [5.0, -7.0, 100.0]
    pairs = np.linalg.norm(points[:, None] - points[None], axis=2)
    assert diameter(points) == pytest.approx(pairs.max(), rel=1e-12)


def test_of_a_round_shape_with_more_points_than_are_compared() -> None:
    points = np.random.default_rng(0).normal(size=(20_000, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    points[17], points[4711] = [0.0, 0.6, 0.80001], [0.0, -0.6, -0.80001]
    assert 2.0 * (1.0 - 1e-4) < diameter(points) <= 2.00003
