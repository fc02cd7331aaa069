"""Of several views the one that is right is believed, by the voxels alone."""

from dataclasses import replace

import numpy as np
import pytest

from model.detector import Detector
from model.geometry.frames import UnitFrame
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect, rotation_matrix
from model.geometry.voxels import voxelize
from model.network.checkpoint import InputSpec, load_checkpoint
from model.network.proposals import Proposals, predict
from model.network.views import VIEWS, other_views, select_proposals
from model.types import FloatArray, IntArray
from tests.shapes import known

EDGES = (0.5, 0.42, 0.3)
QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
FACES: IntArray = np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))], dtype=np.int32)
TURN = rotation_matrix(np.array([0.6, 0.0, 0.8]), 0.4)
"""From the unit frame to the frame of the voxels."""


def box(edges: tuple[float, float, float] = EDGES) -> FloatArray:
    x, y, z = (np.array([-edge / 2, edge / 2]) for edge in edges)
    return np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)


def planes(turn: FloatArray) -> FloatArray:
    """The coordinate planes, turned."""
    return np.column_stack([turn, np.zeros(3)])


def says(turn: FloatArray) -> Proposals:
    return Proposals(planes(turn), turn.copy(), np.full(3, np.pi))


def test_further_views_are_other_proper_frames():
    views = other_views(TURN)
    assert len(views) == VIEWS - 1
    for view in views:
        np.testing.assert_allclose(view @ view.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(view) > 0
        assert np.abs(view @ TURN.T).max(1).min() < 0.8  # some axis lies between those of the main view


def test_what_fits_the_voxels_is_chosen_from_any_view():
    """The box stands in the unit frame as it is; one view is wrong about two of its three planes and axes."""
    voxels = voxelize(box() @ TURN.T, FACES)
    wrong = rotation_matrix(np.array([1.0, 0.0, 0.0]), np.pi / 4)
    for said in ([says(wrong), says(np.eye(3))], [says(np.eye(3)), says(wrong)]):
        chosen = select_proposals(said, voxels, TURN, 3, 3)
        for found in (chosen.planes[:, :3], chosen.directions):
            np.testing.assert_allclose(np.abs(found @ np.eye(3)).max(1), 1.0, atol=1e-9)
            assert len(np.unique(np.abs(found).argmax(1))) == 3
        np.testing.assert_array_equal(chosen.angles, np.pi)


@pytest.mark.parametrize("degrees", [1.5, 3.0])
def test_the_voxels_tell_planes_apart_that_differ_by_a_degree_or_two(degrees: float):
    voxels = voxelize(box() @ TURN.T, FACES)
    axis = np.array([0.48, 0.6, 0.64])
    near = [says(rotation_matrix(axis, sign * np.radians(degrees))) for sign in (1.0, -1.0)]
    chosen = select_proposals([near[0], says(np.eye(3)), near[1]], voxels, TURN, 3, 3)
    np.testing.assert_array_equal(np.sort(chosen.planes, axis=0), np.sort(planes(np.eye(3)), axis=0))


def test_one_plane_is_not_listed_twice():
    voxels = voxelize(box() @ TURN.T, FACES)
    twice = Proposals(planes(np.eye(3))[[0, 0, 1]], np.eye(3)[[0, 0, 1]], np.full(3, np.pi))
    chosen = select_proposals([twice, twice], voxels, TURN, 3, 3)
    for found in (chosen.planes[:, :3], chosen.directions):
        cosines = np.abs(found @ found.T) - np.eye(len(found))
        assert cosines.max() < np.cos(np.radians(30.0))
        np.testing.assert_allclose(np.abs(found[:2, :2]).sum(0), 1.0, atol=1e-12)


def test_the_planes_of_the_frame_are_kept_where_the_network_is_wrong():
    """Off by three degrees, as a network may be that was trained on damaged shapes: the whole box says so."""
    off = rotation_matrix(np.array([0.48, 0.6, 0.64]), 0.05)
    principal = np.eye(3)[[2, 0, 1]]
    chosen = select_proposals([says(off @ principal)] * VIEWS, voxelize(box() @ principal.T, FACES), principal, 3, 3)
    for found in (chosen.planes[:, :3], chosen.directions):
        np.testing.assert_allclose(np.sort(np.abs(found).max(1)), 1.0, atol=1e-12)
    np.testing.assert_allclose(chosen.planes[:, 3], 0.0, atol=1e-12)


def test_the_axis_of_revolution_is_not_displaced_by_those_across_it():
    """Half turns about all directions across the axis fit as well, here all of them better than the axis itself."""
    shape = known("torus")
    vertices = UnitFrame.of(shape.vertices, shape.faces).to_unit(shape.vertices)
    axis = shape.axes[0].direction
    across = np.linalg.svd(axis[None])[2][1:]
    angles = np.radians(np.arange(0.0, 180.0, 35.0))
    directions = np.cos(angles)[:, None] * across[0] + np.sin(angles)[:, None] * across[1]
    tilted = axis + 0.05 * across[0]
    said = np.vstack([directions, tilted / np.linalg.norm(tilted)])
    turn = rotation_matrix(np.array([0.0, 0.6, 0.8]), 0.7)
    voxels = voxelize(np.ascontiguousarray(vertices @ turn.T), shape.faces)
    chosen = select_proposals([Proposals(np.zeros((0, 4)), said, np.full(len(said), np.pi))], voxels, turn, 0, 3)
    assert len(chosen.planes) == 0
    assert np.abs(chosen.directions @ axis).max() > 0.99


def test_no_more_is_chosen_than_there_are_heads():
    voxels = voxelize(box() @ TURN.T, FACES)
    mute = [Proposals(planes(turn), np.zeros((0, 3)), np.zeros(0)) for turn in (np.eye(3), TURN)]
    chosen = select_proposals(mute, voxels, TURN, 2, 0)
    assert len(chosen.planes) == 2
    assert chosen.directions.shape == (0, 3)
    assert len(chosen.angles) == 0


def test_means_of_mirrored_frames_are_exact_where_the_shape_is_symmetric():
    """A shape of one plane, across an axis of the frame: heads may err along it, but their means do not."""
    checkpoint = load_checkpoint("default")
    vertices = box() + np.where(box()[:, [0]] > 0, 1.0, 0.0) * np.array([[0.0, 0.05, 0.0]])  # still even along z
    grid = voxelize(vertices, FACES)
    for frames, exact in ((1, False), (2, True)):
        spec = InputSpec(checkpoint.input.frame, 1, frames)
        said = predict(replace(checkpoint, input=spec), [grid], [np.eye(3)])[0]
        upright = said.planes[np.abs(said.planes[:, 2]) > 0.9]
        assert len(upright)
        for directions in (said.planes[:, :3], said.directions):
            np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-14)
        errors = np.abs(upright - np.array([0.0, 0.0, 1.0, 0.0]) * np.sign(upright[:, [2]])).max(1)
        assert (errors.min() < 1e-12) == exact
        assert errors.max() > 1e-5


def test_a_square_tower_is_seen_better_from_several_views():
    """Its two short axes tie: the inertia frame stands at any angle to the sides, which a trace of noise decides."""
    checkpoint = load_checkpoint("default")
    errors: dict[int, list[float]] = {1: [], VIEWS: []}
    for turn in np.arange(0.0, 0.8, 0.1):
        vertices = box((0.4, 0.4, 0.9)) @ rotation_matrix(np.array([0.0, 0.0, 1.0]), turn).T
        vertices += np.random.default_rng(0).normal(scale=1e-4, size=vertices.shape)
        surface = SurfaceIndex(vertices, FACES)
        samples, _ = sample_surface(vertices, FACES, 500, seed=0)
        for views, found in errors.items():
            spec = InputSpec(checkpoint.input.frame, checkpoint.input.passes, 1, views)
            planes = Detector(replace(checkpoint, input=spec)).propose(vertices, FACES).planes
            upright = planes[np.abs(planes[:, 2]) < 0.5]
            found.append(min(surface.mean_squared_distance(reflect(samples, plane)) for plane in upright))
    assert np.max(errors[VIEWS]) < 4e-4
    assert np.mean(errors[VIEWS]) < 0.7 * np.mean(errors[1])
