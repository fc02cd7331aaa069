"""The SHREC protocol: what it counts, worked out by hand; and real methods on clouds of known planes."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from model.geometry.transforms import rotation_matrix
from training.__main__ import app
from training.evaluation import shrec
from training.evaluation.matching import Found
from training.evaluation.method import Answer
from training.evaluation.report import average_precision
from training.evaluation.shrec import Options, evaluate_clouds, met, ranked, summarise_clouds
from training.shapes.clouds import KnownCloud

BOX = np.array([[x, y, z] for x in (-2.0, 2.0) for y in (-1.0, 1.0) for z in (-0.5, 0.5)])
CLOUD = KnownCloud(
    "box", False, BOX + np.array([5.0, 0.0, 0.0]), np.array([[1, 0, 0, -5.0], [0, 1, 0, 0], [0, 0, 1, 0]])
)
CENTRE = np.array([5.0, 0.0, 0.0])
DIAGONAL = np.linalg.norm([4.0, 2.0, 1.0])


def tilted(degrees: float, shift: float = 0.0) -> np.ndarray:
    """The plane z = 0 turned about the line through the cloud's centre along x, and moved along its normal."""
    normal = rotation_matrix(np.array([1.0, 0, 0]), np.radians(degrees)) @ [0.0, 0.0, 1.0]
    return np.append(normal, -normal @ CENTRE - shift)


def test_a_plane_is_right_within_a_degree_and_a_hundredth_of_the_diagonal():
    planes = np.array([tilted(0.9), tilted(1.1), tilted(0.0, 0.009 * DIAGONAL), tilted(0.0, 0.011 * DIAGONAL)])
    assert [met(CLOUD, plane[None])[0] for plane in planes] == [[True], [False], [True], [False]]
    assert [met(CLOUD, -plane[None])[0] for plane in planes] == [[True], [False], [True], [False]]
    assert met(CLOUD, planes[:1])[1] == pytest.approx([0.9])


def test_a_plane_returned_twice_is_right_once():
    planes = np.array([tilted(0.0), tilted(0.5), [1.0, 0, 0, -5.0], [0.6, 0.8, 0, -3.0]])
    assert met(CLOUD, planes)[0] == [True, False, True, False]
    assert met(CLOUD, np.zeros((0, 4))) == ([], [])


def test_average_precision_is_that_of_the_track():
    assert average_precision([True, True]) == 1.0
    assert average_precision([False, True, False, True]) == pytest.approx((1 / 2 + 2 / 4) / 2)
    assert average_precision([True, False, False]) == 1.0  # nothing behind the last right one counts
    assert average_precision([False]) == average_precision([]) == 0.0


def test_the_most_confident_comes_first_and_ties_keep_their_order():
    planes = np.eye(4)
    assert ranked(Answer(Found(planes), confidence=[0.2, 0.9, 0.2, 0.5])).argmax(1).tolist() == [1, 3, 0, 2]
    assert ranked(Answer(Found(planes))).argmax(1).tolist() == [0, 1, 2, 3]


def test_figures_of_three_clouds():
    def record(true: int, matches: list[bool]) -> dict[str, object]:
        answer = {"title": "M", "matches": matches, "angles": [0.5] * sum(matches), "ms": 1.0}
        return {"true_planes": true, "points": 10, "methods": {"m": answer}}

    figures = summarise_clouds([record(2, [True, True]), record(4, [False, True]), record(2, [])])["m"]
    assert figures["map"] == pytest.approx((1.0 + 0.5 + 0.0) / 3)
    assert figures["phc"] == figures["all_planes"] == pytest.approx(1 / 3)
    assert figures["recall"] == pytest.approx(3 / 8)
    assert figures["returned"] == pytest.approx(4 / 3)
    assert figures["wrong"] == pytest.approx(1 / 3)
    with pytest.raises(ValueError, match="no cloud"):
        summarise_clouds([])


def test_full_mode_finds_the_planes_of_clean_clouds_and_tells_how_sure_it_is():
    records = evaluate_clouds(Options("clean", ("full", "pca")), limit=5, progress=False)
    figures = summarise_clouds(records)
    assert figures["full"]["recall"] >= 0.8
    assert figures["full"]["phc"] >= 0.8
    assert figures["full"]["recall"] > figures["pca"]["recall"]
    assert figures["full"]["angle"] < 0.2


def test_a_cloud_that_no_surface_joins_counts_as_unanswered(monkeypatch: pytest.MonkeyPatch):
    few = KnownCloud("few", True, np.zeros((3, 3)), CLOUD.planes)
    monkeypatch.setattr(shrec, "draw_cloud", lambda *arguments: few)
    figures = summarise_clouds(evaluate_clouds(Options("clean", ("pca",)), limit=1, progress=False))["pca"]
    assert (figures["shapes"], figures["map"], figures["recall"], figures["returned"]) == (1, 0.0, 0.0, 0.0)


def test_the_command_writes_a_table_a_perturbation(tmp_path: Path):
    out = tmp_path / "out.json"
    arguments = ["evaluate", "--protocol", "shrec", "--methods", "pca", "--limit", "2", "--json", str(out)]
    result = CliRunner().invoke(app, [*arguments, "--damage", "clean,severe", "--no-progress"])
    assert result.exit_code == 0, result.output
    assert "clean: 2 clouds of 6400 points" in result.output
    assert "severe: 2 clouds of 640 points" in result.output
    assert [len(part["clouds"]) for part in json.loads(out.read_text())] == [2, 2]
    assert list(tmp_path.iterdir()) == [out]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--protocol", "shrec", "meshes"], "takes no folder"),
        ([], "meshes come from folders"),
        (["--protocol", "olympics", "meshes"], "protocol is meshes or shrec"),
        (["--protocol", "shrec", "--damage", "rotated"], "perturbation is one of"),
        (["--protocol", "shrec", "--methods", "magic"], "magic"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(arguments: list[str], message: str):
    result = CliRunner().invoke(app, ["evaluate", *arguments], env={"COLUMNS": "300"})
    assert result.exit_code == 2
    assert message in result.output
