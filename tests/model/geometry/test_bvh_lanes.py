"""Distances in vector instructions against the plain formulas."""

import numpy as np

from model._jit import jit
from model.geometry._bvh import FANOUT, LANES, Tree
from model.geometry._bvh_frames import near_leaf
from model.geometry._bvh_lanes import lowest, near_boxes
from model.geometry.surface import SurfaceIndex


@jit
def boxes_near(boxes: np.ndarray, place: np.ndarray, enough: float, squared: np.ndarray) -> int:
    return near_boxes(boxes, 6 * FANOUT, place[0], place[1], place[2], enough, squared)


@jit
def leaf_near(leaf: int, place: np.ndarray, enough: float, tree: Tree, squared: np.ndarray) -> int:
    return near_leaf(leaf, place[0], place[1], place[2], enough, tree, squared)


@jit
def lowest_bit(bits: int) -> int:
    return lowest(bits)


def bits_of(mask: np.ndarray) -> int:
    return sum(1 << k for k in np.flatnonzero(mask).tolist())


def test_boxes_are_as_far_as_their_sides_and_absent_ones_infinitely_far() -> None:
    rng = np.random.default_rng(0)
    low = rng.uniform(-1.0, 1.0, (3, FANOUT))
    high = low + rng.uniform(0.0, 0.5, (3, FANOUT))
    low[:, 3], high[:, 3] = np.inf, -np.inf
    boxes = np.concatenate([np.zeros(6 * FANOUT), low.ravel(), high.ravel()])  # the second node
    squared = np.empty(FANOUT)
    for place in rng.uniform(-1.0, 1.0, (50, 3)):
        expected = np.square(np.maximum(np.maximum(low.T - place, place - high.T), 0.0)).sum(1)
        enough = float(np.median(expected))
        assert boxes_near(boxes, place, enough, squared) == bits_of(expected < enough)
        np.testing.assert_allclose(squared, expected, rtol=1e-15)
    assert squared[3] == np.inf


def test_triangles_are_as_far_as_their_nearest_point() -> None:
    rng = np.random.default_rng(1)
    vertices = rng.normal(size=(3 * LANES, 3))
    vertices[-3:] = vertices[-3] + np.array([[0.0], [1.0], [0.4]]) * vertices[-2]  # one without area
    faces = np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
    tree = SurfaceIndex(vertices, faces).tree
    share = np.linspace(0.0, 1.0, 201)
    first, second = (grid.ravel() for grid in np.meshgrid(share, share))
    inside = first + second <= 1.0 + 1e-12
    weights = np.stack([1.0 - first - second, first, second], axis=1)[inside]
    squared = np.empty(LANES)
    for leaf in range(len(tree.owners) // LANES):
        of_leaf = weights @ tree.vertices[tree.faces[tree.owners[leaf * LANES : (leaf + 1) * LANES]]]
        assert tree.frames_of[leaf] == 0  # made when it is looked at
        for place in rng.normal(size=(20, 3)):
            dense = np.square(of_leaf - place).sum(2).min(1)  # from a dense grid of their points
            enough = float(np.median(dense))
            assert leaf_near(leaf, place, enough, tree, squared) == bits_of(squared < enough)
            assert (squared <= dense + 1e-12).all()
            np.testing.assert_allclose(np.sqrt(squared), np.sqrt(dense), atol=0.03)


def test_the_lowest_bit_is_found() -> None:
    assert [lowest_bit(1 << k | 1 << 7) for k in range(8)] == list(range(8))
