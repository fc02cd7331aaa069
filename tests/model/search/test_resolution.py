"""What coordinates may be off by: told from the numbers themselves."""

import numpy as np
import pytest

from model.search.exactness import resolution_of

RANDOM = np.random.default_rng(0).uniform(-1.0, 1.0, (400, 3))


@pytest.mark.parametrize("step", [1e-3, 1e-4, 2.0**-9, 2.0**-13, 2.0**-16])
def test_a_grid_with_many_values_is_half_of_a_cell(step: float) -> None:
    assert resolution_of(np.round(RANDOM / step) * step) == pytest.approx(0.5 * 3.0**0.5 * step)


def test_a_very_fine_grid_shows_in_few_values() -> None:
    few = np.round(RANDOM[:12] * 65536) / 65536
    assert resolution_of(few) == pytest.approx(0.5 * 3.0**0.5 / 65536)


@pytest.mark.parametrize("step", [0.1, 0.25, 0.05])
def test_what_is_drawn_by_hand_is_no_rounding(step: float) -> None:
    assert resolution_of(np.round(RANDOM / step) * step) < 1e-6


def test_single_and_double_precision() -> None:
    assert resolution_of(RANDOM) == pytest.approx(2.0**-52, rel=0.01)
    assert resolution_of(RANDOM.astype(np.float32).astype(np.float64)) == pytest.approx(2.0**-23, rel=0.01)
