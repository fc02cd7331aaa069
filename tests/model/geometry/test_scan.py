"""The coarse scan: it starts near every true plane and two-fold axis, and knows when there is nothing."""

import numpy as np
import pytest

from model.geometry.frames import UnitFrame
from model.geometry.operations import Operations
from model.geometry.scan import DistanceGrid, directions, minima
from model.geometry.voxels import voxelize
from tests.shapes import known
from training.shapes.solids import random_rotation


def scanned(family: str, seed: int = 0, **parameters: object) -> tuple[DistanceGrid, np.ndarray, np.ndarray]:
    """The grid of a shape in a random pose, its planes' normals and its axes of even order in that pose."""
    shape = known(family, seed, **parameters)
    turn = random_rotation(np.random.default_rng(seed))
    frame = UnitFrame.of(shape.vertices, shape.faces)
    vertices = np.ascontiguousarray(frame.to_unit(shape.vertices) @ turn.T)
    even = [axis.direction for axis in shape.axes if axis.order and axis.order % 2 == 0]
    return (
        DistanceGrid(voxelize(vertices, shape.faces)),
        shape.planes[:, :3] @ turn.T,
        np.reshape(even, (-1, 3)) @ turn.T,
    )


def nearest_degrees(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip(np.abs(found @ true.T).max(0), 0.0, 1.0)))


def test_directions_cover_the_hemisphere_evenly():
    cosines = np.abs(directions() @ directions().T)
    np.fill_diagonal(cosines, 0.0)
    gaps = np.degrees(np.arccos(cosines.max(1)))
    assert gaps.min() > 2.5
    assert gaps.max() < 5.5


@pytest.mark.parametrize(("family", "n"), [("chair", None), ("prism", 5), ("pyramid", 4), ("table", None)])
@pytest.mark.parametrize("seed", range(3))
def test_every_plane_has_a_minimum_nearby(family: str, n: int | None, seed: int):
    grid, normals, _ = scanned(family, seed, **({} if n is None else {"n": n}))
    found = minima(grid.scan()[0], 14, 1.5)
    assert nearest_degrees(found, normals).max() < 7.0


@pytest.mark.parametrize("seed", range(3))
def test_every_two_fold_axis_has_a_minimum_nearby(seed: int):
    grid, _, axes = scanned("dihedral", seed, n=4)
    assert len(axes) == 5
    assert nearest_degrees(minima(grid.scan()[1], 14), axes).max() < 7.0


def test_scores_of_true_planes_are_far_below_those_of_others():
    grid, normals, _ = scanned("chair")
    mirror = Operations.reflections(np.column_stack([normals, -normals @ grid.centre]))
    assert grid.score(mirror).max() < 0.1 * np.median(grid.scan()[0])


def test_distances_are_cut_off_and_zero_on_the_surface():
    occupied = np.zeros((16, 16, 16), dtype=bool)
    occupied[8, 8, 8] = True
    grid = DistanceGrid(occupied)
    middle = (8 + 0.5) / 16 - 0.5
    # A half turn about an axis half as far away moves the one point by as much as is asked for.
    for steps, expected in (
        ((0, 0), 0),
        ((1, 0), 1),
        ((2, 0), 4),
        ((3, 0), 9),
        ((6, 0), 9),
        ((1, 2), 5),
        ((640, 0), 9),
    ):
        place = middle + np.array([*steps, 0.0]) / 32
        turn = Operations.rotations(np.array([0.0, 0.0, 1.0]), place, np.pi)
        assert grid.score(turn) == expected


def test_misfit_is_interpolated_between_cells():
    occupied = np.zeros((16, 16, 16), dtype=bool)
    occupied[8, 8, 8] = True
    grid = DistanceGrid(occupied)
    np.testing.assert_allclose(grid.points, [[0.5 / 16] * 3])
    # A mirror half as far away moves the point by as much as is asked for.
    for steps, expected in ((0.0, 0.0), (0.25, 0.25), (1.0, 1.0), (1.5, 1.5), (2.0, 2.0), (5.0, 2.0), (400.0, 2.0)):
        mirror = Operations.reflections(np.array([[1.0, 0.0, 0.0, -(0.5 + steps / 2) / 16]]))
        np.testing.assert_allclose(grid.interpolated_error(mirror), expected**2, rtol=1e-6)


def test_misfit_is_least_at_the_true_plane():
    grid, normals, _ = scanned("chair")
    normal = normals[0]
    side = np.cross(normal, [0.6, 0.0, 0.8])
    side /= np.linalg.norm(side)
    tilts = np.radians([-4.0, -2.0, 0.0, 2.0, 4.0])
    tilted = np.cos(tilts)[:, None] * normal + np.sin(tilts)[:, None] * side
    interpolated_error = grid.interpolated_error(Operations.reflections(np.column_stack([tilted, np.zeros(5)])))
    assert interpolated_error.argmin() == 2
    assert (np.diff(interpolated_error) * np.array([-1, -1, 1, 1]) > 0).all()
