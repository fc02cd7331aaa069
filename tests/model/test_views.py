"""Of several views the one that is right is believed, by the voxels alone."""

import numpy as np

from model.checkpoint import Checkpoint, InputSpec, load_checkpoint
from model.detector import Detector
from model.proposals import Proposals
from model.sampling import sample_surface
from model.surface import SurfaceIndex
from model.transforms import reflect, rotation_matrix
from model.types import FloatArray, IntArray
from model.views import VIEWS, choose, other_views
from model.voxels import voxelize

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
    """The box stands in the unit frame as it is; the main view is wrong about two of its three planes and axes."""
    voxels = voxelize(box() @ TURN.T, FACES)
    wrong = rotation_matrix(np.array([1.0, 0.0, 0.0]), np.pi / 4)
    for views in ([says(wrong), says(np.eye(3))], [says(np.eye(3)), says(wrong)]):
        chosen = choose(views, voxels, TURN)
        for found in (chosen.planes[:, :3], chosen.directions):
            np.testing.assert_allclose(np.abs(found @ np.eye(3)).max(1), 1.0, atol=1e-9)
            assert len(np.unique(np.abs(found).argmax(1))) == 3
        np.testing.assert_array_equal(chosen.angles, np.pi)


def test_the_main_view_is_kept_where_the_others_agree():
    """It is the mean of many frames: nearly the same, said by one frame alone, does not replace it."""
    voxels = voxelize(box() @ TURN.T, FACES)
    near = rotation_matrix(np.array([0.0, 1.0, 0.0]), 0.01)
    chosen = choose([says(np.eye(3)), says(near), says(near.T)], voxels, TURN)
    np.testing.assert_array_equal(np.sort(chosen.planes, axis=0), np.sort(planes(np.eye(3)), axis=0))


def test_one_plane_is_not_listed_twice():
    voxels = voxelize(box() @ TURN.T, FACES)
    twice = Proposals(planes(np.eye(3))[[0, 0, 1]], np.eye(3)[[0, 0, 1]], np.full(3, np.pi))
    chosen = choose([twice, twice], voxels, TURN)
    for found in (chosen.planes[:, :3], chosen.directions):
        cosines = np.abs(found @ found.T) - np.eye(len(found))
        assert cosines.max() < np.cos(np.radians(30.0))
        np.testing.assert_allclose(np.abs(found[:2, :2]).sum(0), 1.0, atol=1e-12)


def test_the_planes_of_the_frame_are_kept_where_the_network_is_wrong():
    """Off by three degrees, as a network may be that was trained on damaged shapes: the whole box says so."""
    off = rotation_matrix(np.array([0.48, 0.6, 0.64]), 0.05)
    principal = np.eye(3)[[2, 0, 1]]
    chosen = choose([says(off @ principal)] * VIEWS, voxelize(box() @ principal.T, FACES), principal)
    for found in (chosen.planes[:, :3], chosen.directions):
        np.testing.assert_allclose(np.sort(np.abs(found).max(1)), 1.0, atol=1e-12)
    np.testing.assert_allclose(chosen.planes[:, 3], 0.0, atol=1e-12)


def test_a_network_without_rotations_has_views_too():
    voxels = voxelize(box() @ TURN.T, FACES)
    mute = [Proposals(planes(turn), np.zeros((0, 3)), np.zeros(0)) for turn in (np.eye(3), TURN)]
    chosen = choose(mute, voxels, TURN)
    assert chosen.directions.shape == (0, 3)
    assert len(chosen.planes) == 3


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
            spec = InputSpec(checkpoint.input.frame, checkpoint.input.passes, checkpoint.input.sign_frames, views)
            planes = Detector(Checkpoint(checkpoint.network, spec, checkpoint.metadata)).propose(vertices, FACES).planes
            upright = planes[np.abs(planes[:, 2]) < 0.5]
            found.append(min(surface.mean_squared_distance(reflect(samples, plane)) for plane in upright))
    assert np.max(errors[VIEWS]) < 4e-4
    assert np.mean(errors[VIEWS]) < 0.7 * np.mean(errors[1])
