"""What depth images see: of a convex shape the sides that face the camera, of a shape behind another nothing."""

import numpy as np

from model.geometry.frames import UnitFrame, triangle_areas
from tests.shapes import box
from training.evaluation.corruptions import corrupt
from training.inputs.depth import visible_part


def area(vertices: np.ndarray, faces: np.ndarray) -> float:
    return float(triangle_areas(vertices[faces]).sum())


def test_of_a_box_the_three_sides_towards_the_camera_are_seen():
    mesh = box(1.0, 2.0, 3.0)
    direction = np.array([0.5, 0.6, -np.sqrt(0.39)])
    vertices, faces = visible_part(mesh.vertices, mesh.faces, direction[None])
    # The camera looks along the direction: it sees the sides at -x, -y and +z, 2 x 3, 1 x 3 and 1 x 2.
    middle = vertices[faces].mean(1)
    towards = np.isclose(middle[:, 0], -0.5) | np.isclose(middle[:, 1], -1.0) | np.isclose(middle[:, 2], 1.5)
    seen = triangle_areas(vertices[faces])
    assert seen[towards].sum() > 0.97 * 11.0
    assert seen[~towards].sum() < 0.05 * 11.0


def test_of_two_sheets_the_front_one_is_seen_and_three_views_see_more_than_one():
    square = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    vertices = np.concatenate([square, square + np.array([0.0, 0.0, 1.0])])
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], dtype=np.int32)
    seen_vertices, seen = visible_part(vertices, faces, np.array([[0.0, 0.0, 1.0]]))
    np.testing.assert_allclose(seen_vertices[np.unique(seen), 2], 0.0)
    assert area(seen_vertices, seen) > 3.9
    mesh = box()
    one, three = (corrupt(mesh.vertices, mesh.faces, damage, 3, 1) for damage in ("depth1", "depth3"))
    scale = one.similarity.scale
    whole = area(mesh.vertices, mesh.faces)
    assert (
        0.2 * whole
        < area(one.vertices, one.faces) / scale**2 * UnitFrame.of(mesh.vertices, mesh.faces).scale ** 2
        < 0.6 * whole
    )
    assert area(three.vertices, three.faces) / three.similarity.scale**2 > area(one.vertices, one.faces) / scale**2
