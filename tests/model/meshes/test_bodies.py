"""Bodies inside others: found, counted, and told where they break what the outside has."""

import numpy as np
import pytest
import trimesh

from model import Detector, Mesh
from model.meshes.bodies import inner_faces

BOX = trimesh.creation.box((10, 6, 4))
ABOUT_INSIDE = "inside another one"


def joined(*parts: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.util.concatenate(parts)


def block(center: tuple[float, float, float], size: float = 1.0) -> trimesh.Trimesh:
    made = trimesh.creation.box((size, 1.2 * size, 0.8 * size))
    made.apply_translation(center)
    return made


@pytest.fixture(scope="module")
def detector() -> Detector:
    return Detector.load()


def inside_of(mesh: trimesh.Trimesh) -> tuple[np.ndarray, int]:
    return inner_faces(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int32))


def test_bodies_inside_are_found_however_faces_are_ordered_or_turned() -> None:
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.5)
    ball.apply_translation((-2, 1, 0.3))
    mesh = joined(block((2, 1, 0.5)), BOX, ball, block((20, 0, 0)))
    expected = np.repeat([True, False, True, False], [12, 12, len(ball.faces), 12])
    found, count = inside_of(mesh)
    assert count == 2
    assert (found == expected).all()
    rng = np.random.default_rng(0)
    order = rng.permutation(len(mesh.faces))
    shuffled = trimesh.Trimesh(
        mesh.triangles[order].reshape(-1, 3), np.arange(3 * len(order)).reshape(-1, 3), process=False
    )
    assert (inside_of(shuffled)[0] == expected[order]).all()
    mesh.invert()
    assert (inside_of(mesh)[0] == expected).all()


@pytest.mark.parametrize(
    "mesh",
    [
        BOX,
        joined(BOX, block((5, 0, 0))),  # through the wall
        joined(BOX, block((5.2, 0, 0))),  # through it too
        joined(BOX, block((4.5, 0, 0))),  # touches the wall
        joined(BOX, BOX),
        joined(trimesh.Trimesh(BOX.vertices, BOX.faces[BOX.face_normals[:, 2] < 0.5]), block((0, 0, 1))),  # a tray
        joined(trimesh.creation.torus(5, 1), block((0, 0, 0))),  # in the hole
    ],
)
def test_what_can_be_seen_from_outside_is_not_inside(mesh: trimesh.Trimesh) -> None:
    found, count = inside_of(mesh)
    assert count == 0
    assert not found.any()


def test_a_body_in_a_body_in_a_body() -> None:
    assert inside_of(joined(BOX, block((0, 0, 0), 2.0), block((0.1, 0, 0), 0.5)))[1] == 2


def test_so_many_bodies_that_it_would_take_long_are_not_asked_about() -> None:
    leaves = joined(BOX, *(block((0.00103 * k, 0, 0), 0.1) for k in range(600)))
    assert inside_of(leaves)[1] == 0


def about_inside(detector: Detector, mesh: trimesh.Trimesh) -> list[str]:
    found = detector.detect(Mesh.checked(mesh.vertices, mesh.faces))
    return [text for text in found.warnings if ABOUT_INSIDE in text]


def test_what_breaks_the_outside_is_told_with_what_that_has(detector: Detector) -> None:
    (text,) = about_inside(detector, joined(BOX, block((2, 1, 0.7))))
    assert text.startswith("One body lies inside another one. Without it the shape has D2h exactly, with it ")
    (text,) = about_inside(detector, joined(BOX, block((2, 1, 0.7)), block((-3, -1.5, 0.4), 0.8)))
    assert text.startswith("2 bodies lie inside another one. Without them the shape has D2h exactly, with them ")
    can = trimesh.creation.cylinder(3, 8, sections=64)
    (text,) = about_inside(detector, joined(can, block((1, 0.3, 2.0))))
    assert "has Dinfh" in text


def test_what_lies_in_the_middle_breaks_nothing(detector: Detector) -> None:
    (text,) = about_inside(detector, joined(BOX, block((0, 0, 0))))
    assert "counts as surface" in text
    assert about_inside(detector, BOX) == []
