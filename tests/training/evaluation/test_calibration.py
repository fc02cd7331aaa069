"""Calibration: what is learned is found again, and the check of it can fail."""

from pathlib import Path

import numpy as np
import pytest

from model.search.confidence import NAMES
from training.evaluation.calibration import (
    Group,
    calibrate,
    collect,
    expected_calibration_error,
    reliability,
    render,
    run,
)


def groups(count: int, honest: bool) -> list[Group]:
    """Groups that are right with a probability which their first evidence tells, or which nothing tells."""
    rng = np.random.default_rng(5)
    seen = rng.normal(size=(count, len(NAMES)))
    chance = 1.0 / (1.0 + np.exp(-2.0 * seen[:, 0])) if honest else np.full(count, 0.5)
    wrong = rng.random(count) > chance
    return [Group(f"shape{k % 150}", "rotated", "Cs", tuple(seen[k]), float(wrong[k])) for k in range(count)]


def test_a_known_probability_is_learned() -> None:
    record = calibrate(groups(3000, honest=True))
    assert record["error"] < 0.05
    assert record["brier"] < 0.2
    assert sum(each["count"] for each in record["reliability"]) == record["checked"]


def test_where_nothing_tells_nothing_is_claimed() -> None:
    record = calibrate(groups(3000, honest=False))
    assert record["brier"] > 0.23
    assert all(0.3 < each["confidence"] < 0.7 for each in record["reliability"] if each["count"] > 50)


def test_a_boast_is_an_error() -> None:
    told, right = np.full(100, 0.95), np.arange(100) < 50
    assert expected_calibration_error(told, right) == pytest.approx(0.45)
    assert reliability(told, right)[0]["right"] == 0.5


def test_procedural_shapes_are_searched_in_every_damage(tmp_path: Path) -> None:
    (tmp_path / "cube.off").write_text(
        "OFF\n8 6 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n"
        "4 0 3 2 1\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n"
    )
    found = collect([tmp_path], limit=1, procedural=1, seed=3, progress=False)
    assert {group.shape.split("/")[0] for group in found} >= {"procedural"}
    whole = [group for group in found if group.name == "Oh" and group.damage == "rotated"]
    assert whole
    assert whole[0].error < 1e-12
    with pytest.raises(ValueError, match="least to learn from"):
        run([tmp_path], tmp_path / "out.json", limit=1, procedural=0, progress=False)


def test_the_table_says_what_was_checked() -> None:
    text = render(calibrate(groups(600, honest=True)))
    assert "expected calibration error" in text
    assert text.count("\n|") > 4
