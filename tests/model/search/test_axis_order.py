"""The order of an axis: all of them up to 24 and beyond, round or not."""

from dataclasses import replace

import numpy as np
import pytest

from model.geometry.frames import UnitFrame
from model.geometry.sampling import SurfaceSampler
from model.geometry.surface import SurfaceIndex
from model.search.axis_order import RotationalSymmetry, rotation_order
from model.search.deviation import DeviationMeter, SurfaceSamples
from tests.shapes import known
from training.shapes.catalogue import KnownShape

Z = np.array([0.0, 0.0, 1.0])


def inspect(shape: KnownShape, direction: np.ndarray = Z, limit: float = 1e-3) -> RotationalSymmetry:
    frame = UnitFrame.of(shape.vertices, shape.faces)
    vertices = frame.to_unit(shape.vertices)
    samples = SurfaceSamples.drawn(SurfaceSampler(vertices, shape.faces), 120, seed=3)
    meter = DeviationMeter(SurfaceIndex(vertices, shape.faces), vertices, shape.faces, near=2e-3)
    return rotation_order(meter, samples, direction, np.zeros(3), limit=limit)


@pytest.mark.parametrize("n", range(3, 26))
def test_prisms_up_to_24_corners_and_one_more(n: int):
    assert inspect(known("prism", 0, n=n)).order == n


@pytest.mark.parametrize(("family", "n"), [("gear", 12), ("cyclic", 9), ("dihedral", 11), ("pyramid", 7)])
def test_other_families(family: str, n: int):
    assert inspect(known(family, 2, n=n)).order == n


@pytest.mark.parametrize("family", ["cylinder", "cone", "torus", "vase", "spindle"])
@pytest.mark.parametrize("segments", [32, 48, 96])
def test_finely_tessellated_surfaces_of_revolution_are_round(family: str, segments: int):
    assert inspect(known(family, 1, segments=segments)).order is None


@pytest.mark.parametrize("n", [65, 72, 96, 127, 180, 251, 360])
def test_high_orders_of_gears(n: int):
    assert inspect(toothed(n)).order == n


def toothed(n: int) -> KnownShape:
    """A disc with n teeth as deep as they are wide."""
    angles = np.pi * np.arange(2 * n) / n
    radii = np.where(np.arange(2 * n) % 2, 1.0, 1.0 - np.pi / n)
    rim = np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])
    count = 2 * n
    vertices = np.concatenate(
        [np.column_stack([rim, np.full(count, z)]) for z in (-0.1, 0.1)] + [[[0, 0, -0.1], [0, 0, 0.1]]]
    )
    here = np.arange(count)
    there = np.roll(here, -1)
    faces = np.concatenate(
        [
            np.column_stack([here, there, there + count]),
            np.column_stack([here, there + count, here + count]),
            np.column_stack([there, here, np.full(count, 2 * count)]),
            np.column_stack([here + count, there + count, np.full(count, 2 * count + 1)]),
        ]
    )
    return replace(known("prism", 0, n=3), vertices=vertices, faces=faces.astype(np.int32))


def test_across_a_prism_only_half_turns_hold():
    assert inspect(known("prism", 0, n=6), np.array([1.0, 0.0, 0.0])).order == 2


def test_an_arbitrary_line_allows_nothing():
    assert inspect(known("prism", 0, n=6), np.array([0.6, 0.0, 0.8])).order == 1
    assert inspect(known("none"), Z).order == 1
