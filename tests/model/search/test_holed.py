"""Symmetries of shapes much of which is missing: the centre of what is left lies beside their planes."""

import numpy as np
import pytest

from model import Detector
from model.geometry.frames import UnitFrame
from tests.shapes import known
from training.evaluation.corruptions import cut_ball

HOLE = 0.25


@pytest.fixture(scope="module")
def detector() -> Detector:
    return Detector.load()


@pytest.mark.parametrize(("family", "number"), [("pyramid", 0), ("pyramid", 1), ("chair", 0), ("box", 5), ("table", 3)])
def test_planes_are_found_beside_a_large_hole(detector: Detector, family: str, number: int) -> None:
    shape = known(family, number)
    vertices, faces = cut_ball(shape.vertices, shape.faces, np.random.default_rng(number), hole=HOLE)
    frame = UnitFrame.of(vertices, faces)
    planes = detector.detect((vertices, faces)).planes
    found = np.array([frame.plane_to_unit(np.append(plane.normal, plane.offset)) for plane in planes])
    assert len(found) == len(shape.planes)
    for plane in shape.planes:
        true = frame.plane_to_unit(np.asarray(plane, dtype=np.float64))
        signs = np.sign(found[:, :3] @ true[:3])[:, None]
        assert np.abs(signs * found - true).max(1).min() < 2e-3


def test_a_plane_beside_one_of_a_group_does_not_move_the_group(detector: Detector) -> None:
    """Of a box without an end, planes beside the middle hold roughly as well: more of it is missing then."""
    shape = known("box", 5)
    vertices, faces = cut_ball(shape.vertices, shape.faces, np.random.default_rng(5), hole=HOLE)
    _, _, found = detector.search(UnitFrame.of(vertices, faces).to_unit(vertices), faces)
    whole = [level for level in found.levels if level.name == "D2h"]
    assert [level.rms < 1e-3 for level in whole] == [True]
