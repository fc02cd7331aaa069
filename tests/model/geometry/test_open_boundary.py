"""What open edges tell of a surface that ends there."""

import numpy as np
import pytest
import trimesh

from model.geometry.edges import EdgeTable
from model.geometry.frames import triangle_areas
from model.geometry.open_boundary import OpenBoundary
from model.geometry.surface import SurfaceIndex
from model.geometry.topology import duplicate_vertex_map
from training.evaluation.corruptions import cut_ball
from training.inputs.depth import visible_part


def boundary(vertices: np.ndarray, faces: np.ndarray) -> OpenBoundary:
    vertices, faces = np.ascontiguousarray(vertices, dtype=np.float64), np.ascontiguousarray(faces, dtype=np.int32)
    first = duplicate_vertex_map(vertices)
    return OpenBoundary(SurfaceIndex(vertices, faces), vertices, faces, first, EdgeTable(first, faces))


def sheet(count: int) -> tuple[np.ndarray, np.ndarray]:
    """A unit square of ``count`` by ``count`` squares, each two triangles."""
    along = np.linspace(0.0, 1.0, count + 1)
    vertices = np.column_stack([grid.ravel() for grid in np.meshgrid(along, along, [0.0], indexing="ij")])
    corner = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    first = np.column_stack([corner, corner + count + 1, corner + count + 2])
    return vertices, np.concatenate([first, np.column_stack([corner, corner + count + 2, corner + 1])]).astype(np.int32)


def bowl() -> tuple[np.ndarray, np.ndarray]:
    """The square pulled round to a half of a sphere: its rim is a circle."""
    vertices, faces = sheet(24)
    flat = 2.0 * vertices[:, :2] - 1.0
    disc = flat * np.sqrt(1.0 - np.square(flat[:, ::-1]) / 2.0)
    return np.column_stack([disc, -np.sqrt(np.maximum(1.0 - np.square(disc).sum(1), 0.0))]), faces


@pytest.mark.parametrize("made", [sheet(1), sheet(12), bowl()], ids=["two triangles", "square", "bowl"])
def test_rims_as_drawn_are_not_ragged(made: tuple[np.ndarray, np.ndarray]):
    drawn = boundary(*made)
    assert not drawn.is_empty
    assert drawn.raggedness == 0.0


def test_rims_where_something_was_torn_off_are_ragged():
    for made in (sheet(40), bowl()):
        vertices, faces = cut_ball(*made, np.random.default_rng(3))
        assert triangle_areas(vertices[faces]).sum() < 0.95 * triangle_areas(made[0][made[1]]).sum()
        assert 0.05 < boundary(vertices, faces).raggedness < 1.0
    seen = visible_part(*bowl(), np.array([[0.6, 0.0, 0.8]]))
    assert boundary(*seen).raggedness > 0.05


def test_a_closed_surface_has_no_rims():
    box = trimesh.creation.box()
    assert boundary(box.vertices, box.faces).raggedness == 0.0


def test_raggedness_does_not_depend_on_which_way_faces_are_turned_or_stored():
    vertices, faces = cut_ball(*sheet(20), np.random.default_rng(5))
    expected = boundary(vertices, faces).raggedness
    rng = np.random.default_rng(1)
    turned = np.where(rng.random(len(faces))[:, None] < 0.5, faces, faces[:, ::-1])[rng.permutation(len(faces))]
    assert boundary(vertices, turned).raggedness == pytest.approx(expected)
    soup = vertices[faces].reshape(-1, 3)
    assert boundary(soup, np.arange(len(soup)).reshape(-1, 3)).raggedness == pytest.approx(expected)
    lengths = boundary(7.0 * vertices, faces).raggedness
    assert lengths == pytest.approx(expected)
