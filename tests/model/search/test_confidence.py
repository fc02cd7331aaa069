"""Confidence: near to one where all fits, lower where much is guessed, none where nothing was judged."""

import numpy as np
import pytest

from model import Detector
from model.search.confidence import NAMES, predict, terms
from tests.shapes import as_mesh, known, moved, pose
from training.evaluation.corruptions import cut_ball


@pytest.fixture(scope="module")
def detector() -> Detector:
    return Detector.load()


@pytest.mark.parametrize("family", ["box", "chair", "gear"])
def test_what_holds_everywhere_is_no_guess(detector: Detector, family: str) -> None:
    detection = detector.detect(moved(as_mesh(known(family, 2)), *pose(3)))
    assert [level.confidence for level in detection.levels if level.chosen] == [1.0]
    assert {plane.confidence for plane in detection.planes} == {1.0}


def test_what_is_missing_makes_a_guess(detector: Detector) -> None:
    mesh = moved(as_mesh(known("table", 2)), *pose(3))
    vertices, faces = cut_ball(mesh.vertices, mesh.faces, np.random.default_rng(1))
    levels = detector.detect((vertices, faces)).levels
    assert levels
    assert all(0.0 <= level.confidence <= 1.0 for level in levels)
    assert min(level.confidence for level in levels) < 1.0


def test_paper_mode_judges_nothing(detector: Detector) -> None:
    detection = detector.detect(as_mesh(known("box", 2)), mode="paper")
    assert detection.planes
    assert all(plane.confidence is None for plane in detection.planes)


def test_rounding_alone_is_certain_whatever_the_coefficients_say() -> None:
    rows = np.zeros((2, len(NAMES)))
    rows[:, NAMES.index("deviation")] = [-3.5, -1.0]
    doubtful = np.zeros(terms(rows).shape[1])
    doubtful[0] = -2.0
    np.testing.assert_allclose(predict(doubtful, rows), [1.0, 1.0 / (1.0 + np.exp(2.0))])


def test_an_open_surface_is_told(detector: Detector) -> None:
    mesh = as_mesh(known("prism", 1, n=6))
    cut = cut_ball(mesh.vertices, mesh.faces, np.random.default_rng(0))
    assert not detector.detect(mesh).warnings
    detection = detector.detect(cut)
    chosen = next(level for level in detection.levels if level.chosen)
    told = [text for text in detection.warnings if "not seen" in text]
    assert chosen.missing > 0.02
    assert told == detection.warnings
    assert f"{100 * chosen.missing:.0f} %" in told[0]


def test_without_symmetry_the_best_candidate_is_told(detector: Detector) -> None:
    chair = as_mesh(known("chair", 2))
    assert detector.detect(chair).planes
    leaning = chair.vertices + 0.12 * chair.vertices[:, [2]] * np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    detection = detector.detect((leaning, chair.faces), max_error=1e-5)
    assert not detection.planes
    errors = [candidate.symmetry_error for candidate in detection.rejected]
    assert any("takes a larger max_error" in text for text in detection.warnings) == (min(errors) <= 4e-5)
    generous = detector.detect((leaning, chair.faces), max_error=min(errors) / 3.0)
    assert any("takes a larger max_error" in text for text in generous.warnings)
