"""The order of an axis: all of them up to 24 and beyond, round or not."""

import numpy as np
import pytest

from model.geometry.frames import UnitFrame
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.search.axis_order import Turns, allowed_turns
from tests.shapes import known
from training.shapes.catalogue import KnownShape

Z = np.array([0.0, 0.0, 1.0])


def inspect(shape: KnownShape, direction: np.ndarray = Z, limit: float = 1e-6) -> Turns:
    frame = UnitFrame.of(shape.vertices, shape.faces)
    vertices = frame.to_unit(shape.vertices)
    samples, _ = sample_surface(vertices, shape.faces, 120, seed=3)
    surface = SurfaceIndex(vertices, shape.faces)
    return allowed_turns(surface, samples, direction, np.zeros(3), limit=limit, max_error=4e-4)


@pytest.mark.parametrize("n", range(3, 26))
def test_prisms_up_to_24_corners_and_one_more(n: int):
    assert inspect(known("prism", 0, n=n)).order == n


@pytest.mark.parametrize(("family", "n"), [("gear", 12), ("cyclic", 9), ("dihedral", 11), ("pyramid", 7)])
def test_other_families(family: str, n: int):
    assert inspect(known(family, 2, n=n)).order == n


@pytest.mark.parametrize("family", ["cylinder", "cone", "torus", "vase", "spindle"])
@pytest.mark.parametrize("segments", [32, 48, 96])
def test_finely_tessellated_surfaces_of_revolution_are_round(family: str, segments: int):
    turns = inspect(known(family, 1, segments=segments))
    assert turns.order is None
    assert turns.exact


def test_across_a_prism_only_half_turns_hold():
    assert inspect(known("prism", 0, n=6), np.array([1.0, 0.0, 0.0])).order == 2


def test_an_arbitrary_line_allows_nothing():
    assert inspect(known("prism", 0, n=6), np.array([0.6, 0.0, 0.8])).order == 1
    assert inspect(known("none"), Z).order == 1
