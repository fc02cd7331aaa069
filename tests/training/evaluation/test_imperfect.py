"""Imperfect shapes: damage does what it says, and the report counts."""

import numpy as np
import pytest

from model.geometry.edges import is_watertight
from training.evaluation.imperfect import render, run
from training.evaluation.imperfections import KINDS
from training.shapes.catalogue import generate


def shown(kind: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    shape = generate("box", np.random.default_rng(2))
    diagonal = float(np.linalg.norm(np.ptp(shape.vertices, axis=0)))
    vertices, faces = KINDS[kind](shape.vertices, shape.faces, np.random.default_rng(4), diagonal)
    return vertices, faces, shape.vertices


@pytest.mark.parametrize("kind", ["made", "retriangulated", "remeshed", "noise-0.5"])
def test_what_is_closed_stays_closed(kind: str) -> None:
    vertices, faces, _ = shown(kind)
    assert is_watertight(vertices, faces)


@pytest.mark.parametrize("kind", ["hole-15", "hole-35", "depth-1", "depth-3"])
def test_what_is_missing_is_missing(kind: str) -> None:
    vertices, faces, _ = shown(kind)
    assert not is_watertight(vertices, faces)


def test_a_box_is_told_and_counted() -> None:
    results = run(["box", "made", "quantised"], shapes=1, seed=1, progress=False)
    assert [result.kind for result in results] == ["made", "quantised"]
    assert all(result.right and result.agrees and result.found == result.elements for result in results)
    assert "| made | 1 of 1 |" in render(results)


def test_unknown_names_are_refused() -> None:
    with pytest.raises(ValueError, match="neither a family nor a kind"):
        run(["teapot"], progress=False)
