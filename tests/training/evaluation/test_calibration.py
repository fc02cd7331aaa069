"""Calibration: what is learned is found again, and the check of it can fail."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from model.search import confidence, prediction
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
    return [Group(f"shape{k % 150}", "rotated", "Cs", tuple(seen[k]), float(wrong[k]), 9.0) for k in range(count)]


def test_a_known_probability_is_learned() -> None:
    record = calibrate(groups(6000, honest=True))["measured"]
    assert record["error"] < 0.05
    assert record["brier"] < 0.2
    assert sum(each["count"] for each in record["reliability"]) == record["checked"]


def test_where_nothing_tells_nothing_is_claimed() -> None:
    record = calibrate(groups(9000, honest=False))["measured"]
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


def guesses(count: int) -> list[Group]:
    """Guesses, three of a mesh, that are right with a probability which their last number tells."""
    rng = np.random.default_rng(7)
    seen = rng.normal(size=(count, len(NAMES) + 2))
    wrong = rng.random(count) > 1.0 / (1.0 + np.exp(-2.0 * seen[:, -1]))
    return [
        Group(f"shape{k // 3 % 150}", f"damage{k // 450}", "Cs", tuple(seen[k]), float(wrong[k]), 9.0, "predicted")
        for k in range(count)
    ]


def test_of_guesses_the_likeliest_of_each_mesh_is_checked() -> None:
    record = calibrate([*groups(600, honest=True), *guesses(3600)])["predicted"]
    assert record["evidence"] == list(prediction.NAMES)
    assert (record["groups"], record["shapes"], record["checked"]) == (3600, 150, 1200)
    assert record["error"] < 0.08
    told = np.average(
        [each["confidence"] for each in record["reliability"]],
        weights=[each["count"] for each in record["reliability"]],
    )
    assert told > 0.6  # the best of three


def test_guesses_are_learned_from_only_where_no_measured_group_is_believed() -> None:
    def learned_from(damage: str) -> int:
        measured = [replace(group, damage=damage) for group in groups(600, honest=True)]
        return int(calibrate([*measured, *guesses(3600)])["predicted"]["groups"])

    assert learned_from("another damage") == 3600
    assert 3600 - 450 < learned_from("damage0") < 3600  # of an eighth of the meshes some have a group to believe


def test_what_is_to_be_learned_need_not_be_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(kind: str, names: tuple[str, ...]) -> confidence.Learned:
        raise ValueError("confidence.json was made for other evidence")

    monkeypatch.setattr(confidence, "learned", unknown)
    monkeypatch.setattr(prediction, "learned", unknown)
    (tmp_path / "box.off").write_text(
        "OFF\n8 5 0\n0 0 0\n1 0 0\n1 2 0\n0 2 0\n0 0 3\n1 0 3\n1 2 3\n0 2 3\n"
        "4 0 3 2 1\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n"
    )
    found = collect([tmp_path], limit=1, seed=3, progress=False)
    assert {group.evidence for group in found} == {"measured", "predicted"}
    assert all(len(group.seen) == len(NAMES) + 2 for group in found if group.evidence == "predicted")


def test_the_table_says_what_was_checked() -> None:
    text = render(calibrate([*groups(600, honest=True), *guesses(900)]))
    assert text.count("expected calibration error") == 2
    assert text.count("\n|") > 8
