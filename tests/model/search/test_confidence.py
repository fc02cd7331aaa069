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
