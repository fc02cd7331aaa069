"""Noise is not difference: how much there is of it, and orders, levels and groups under it."""

import numpy as np
import pytest

from model import Detector
from model.geometry.frames import UnitFrame
from model.geometry.operations import Operations
from model.geometry.sampling import SurfaceSampler
from model.geometry.surface import SurfaceIndex
from model.meshes.mesh import Mesh
from model.search.deviation import DeviationMeter, SurfaceSamples
from model.search.harmonics import harmonics
from tests.shapes import known
from training.evaluation.corruptions import add_noise

ACROSS = Operations.reflections(np.array([[0.0, 0.0, 1.0, 0.0]]))


@pytest.fixture(scope="module")
def detector() -> Detector:
    return Detector.load()


def measured(vertices: np.ndarray, faces: np.ndarray, count: int = 1000) -> tuple[DeviationMeter, SurfaceSamples]:
    """A shape about its own origin, in the size of its unit frame, ready to be measured."""
    vertices = vertices / UnitFrame.of(vertices, faces).scale
    meter = DeviationMeter(SurfaceIndex(vertices, faces), vertices, faces, near=2e-3)
    return meter, SurfaceSamples.drawn(SurfaceSampler(vertices, faces), count, 0)


def prism(corners: int, seed: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """A regular prism about the z axis, with noise of 0.5 % of its diagonal if there is a seed."""
    shape = known("prism", n=corners)
    if seed is None:
        return shape.vertices, shape.faces
    return add_noise(shape.vertices, shape.faces, np.random.default_rng(seed))


def test_noise_is_told_from_a_difference_of_shape() -> None:
    vertices, faces = prism(6, 1)
    meter, samples = measured(vertices, faces)
    deviation, noise = (
        float(values[0]) for values in (meter.measure(ACROSS, samples).rms, meter.noise(ACROSS, samples))
    )
    assert 0.6 * deviation < noise < 1.4 * deviation
    vertices, faces = prism(6)
    moved = vertices + np.array([0.0, 0.0, 0.02])  # every image lies as far off, the same way
    meter, samples = measured(moved, faces)
    assert float(meter.noise(ACROSS, samples)[0]) < 0.3 * float(meter.measure(ACROSS, samples).rms[0])
    meter, samples = measured(vertices, faces)
    assert float(meter.noise(ACROSS, samples)[0]) < 1e-9


@pytest.mark.parametrize("corners", [8, 12, 16])
def test_a_polygon_shows_in_its_harmonics_under_noise(corners: int) -> None:
    meter, samples = measured(*prism(corners, 2))
    found = harmonics(meter, samples, np.array([0.0, 0.0, 1.0]), np.zeros(3))
    assert found[0] == corners
    assert all(order % corners == 0 for order in found)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_cylinder_has_no_harmonics_under_noise(seed: int) -> None:
    meter, samples = measured(*prism(96, seed), count=600)
    assert harmonics(meter, samples, np.array([0.0, 0.0, 1.0]), np.zeros(3)) == []


@pytest.mark.parametrize("corners", [8, 10, 12, 15, 16])
def test_orders_hold_under_noise(detector: Detector, corners: int) -> None:
    vertices, faces = prism(corners, corners)
    detection = detector.detect(Mesh.checked(vertices, faces))
    assert detection.point_group == f"D{corners}h"
    axis = max(detection.axes, key=lambda axis: axis.order or 0)
    assert axis.order == corners
    assert abs(axis.direction[2]) > np.cos(np.deg2rad(1.0))


def test_a_cylinder_stays_round_under_noise(detector: Detector) -> None:
    assert detector.detect(Mesh.checked(*prism(96, 5))).point_group == "Dinfh"


def test_noise_does_not_choose_a_coarser_level(detector: Detector) -> None:
    """A box with one bevelled edge: what it nearly is needs as much more tolerance with noise as without."""
    shape = known("box", 5)
    high, low = shape.vertices.max(0), shape.vertices.min(0)
    vertices = shape.vertices.copy()
    vertices[np.isclose(vertices, high).all(1)] -= 0.06 * (high - low)
    intact = detector.detect(Mesh.checked(vertices, shape.faces))
    noisy = detector.detect(Mesh.checked(*add_noise(vertices, shape.faces, np.random.default_rng(3))))
    assert noisy.point_group == intact.point_group
