"""Full mode: every symmetry of shapes whose group is known, in any pose, and nothing that is none."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from model import Detection, Detector, Mesh
from model.detector import Sources
from model.paper.validation import MAX_ERROR
from model.search.settings import DEFAULT
from tests.model.test_detector import fresh_error
from tests.shapes import as_mesh, box, known, moved, pose, subdivided
from training.evaluation.corruptions import corrupt
from training.shapes.catalogue import KnownShape, families
from training.shapes.solids import random_rotation

ANGLE = np.deg2rad(0.05)
CLEAR_ERROR = DEFAULT.modelling_precision**2


@pytest.fixture(scope="module")
def detector() -> Detector:
    return Detector.load()


def of(solid: trimesh.Trimesh) -> Mesh:
    return Mesh.checked(np.array(solid.vertices), np.array(solid.faces))


def exact(detection: Detection) -> Detection:
    """Only what is symmetric up to modelling precision."""
    return replace(
        detection,
        planes=[plane for plane in detection.planes if plane.exact],
        axes=[axis for axis in detection.axes if axis.exact],
    )


def lines_off(found: np.ndarray, true: np.ndarray) -> float:
    """The largest angle from a true direction to the nearest found one."""
    if not len(true):
        return 0.0
    sines = np.linalg.norm(np.cross(found[:, None], true[None]), axis=2)
    return float(np.arcsin(np.clip(sines.min(0), 0.0, 1.0)).max())


def assert_finds(detection: Detection, shape: KnownShape, rotation: np.ndarray, move: np.ndarray, scale: float) -> None:
    """All planes and axes of a known shape that was turned, scaled and moved, and nothing else that is exact."""
    assert detection.point_group == shape.point_group
    found = exact(detection)
    planes = [plane for plane in found.planes if not plane.continuous]
    continuous = any(axis.order is None for axis in shape.axes)
    if shape.point_group != "Kh":
        assert len(planes) == len(shape.planes)
        normals = np.array([plane.normal for plane in planes]).reshape(-1, 3)
        assert lines_off(normals, shape.planes[:, :3] @ rotation.T) < ANGLE
    centre = move  # the shapes are centred on their own origin
    for plane in planes:
        assert abs(plane.normal @ centre + plane.offset) < 1e-3 * detection.scale
    assert Counter(axis.order for axis in found.axes) == Counter(axis.order for axis in shape.axes)
    if not continuous or shape.point_group != "Kh":
        directions = np.array([axis.direction for axis in found.axes]).reshape(-1, 3)
        true = np.array([axis.direction for axis in shape.axes]).reshape(-1, 3) @ rotation.T
        assert lines_off(directions, true) < (5 * ANGLE if continuous else ANGLE)
    for axis in found.axes:
        off = axis.point - centre
        assert np.linalg.norm(off - (off @ axis.direction) * axis.direction) < 1e-3 * detection.scale


@pytest.mark.parametrize("family", families())
def test_all_families_in_any_pose(detector: Detector, family: str):
    for seed in range(2):
        shape = known(family, seed)
        rotation, move, scale = pose(seed + 7)
        mesh = moved(as_mesh(shape), rotation, move, scale)
        # Without the threshold for what is only similar, nothing but the group itself is left.
        detection = detector.detect(mesh, max_error=CLEAR_ERROR)
        if shape.point_group == "C1":
            assert detection.planes == []
            assert detection.axes == []
        assert_finds(detection, shape, rotation, move, scale)


@pytest.mark.parametrize("n", [3, 4, 5, 7, 12, 16, 24])
def test_prisms_of_many_corners(detector: Detector, n: int):
    shape = known("prism", 0, n=n)
    rotation, move, scale = pose(n)
    detection = detector.detect(moved(as_mesh(shape), rotation, move, scale))
    assert detection.point_group == f"D{n}h"
    assert_finds(detection, shape, rotation, move, scale)


@pytest.mark.parametrize(
    ("solid", "group", "planes", "orders"),
    [
        (trimesh.creation.box((1, 1, 1)), "Oh", 9, {4: 3, 3: 4, 2: 6}),
        (trimesh.creation.box((1, 1, 3)), "D4h", 5, {4: 1, 2: 4}),
        (trimesh.creation.icosahedron(), "Ih", 15, {5: 6, 3: 10, 2: 15}),
        (trimesh.creation.icosphere(2), "Ih", 15, {5: 6, 3: 10, 2: 15}),
        (trimesh.creation.icosphere(3), "Kh", 3, {None: 3}),
        (trimesh.creation.uv_sphere(), "Kh", 3, {None: 3}),
        (trimesh.creation.cylinder(1, 2.2), "Dinfh", 3, {None: 1}),
        (trimesh.creation.cylinder(1, 0.1), "Dinfh", 3, {None: 1}),
        (trimesh.creation.cone(1, 2), "Cinfv", 2, {None: 1}),
        (trimesh.creation.box((1, 1, 0.001)), "D4h", 5, {4: 1, 2: 4}),
        (trimesh.creation.box((0.01, 0.01, 3)), "D4h", 5, {4: 1, 2: 4}),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_solids_everybody_knows(
    detector: Detector, solid: trimesh.Trimesh, group: str, planes: int, orders: dict[int | None, int]
):
    detection = detector.detect(moved(of(solid), *pose(5)))
    assert detection.point_group == group
    assert len(detection.planes) == planes
    assert Counter(axis.order for axis in detection.axes) == orders
    # Round up to its facets: about 1e-6 for a sphere of 32 segments, nothing at all for what is angular.
    limit = 1e-12 if None not in orders else 3e-6
    assert all(plane.symmetry_error < limit for plane in detection.planes)


def test_flat_sheets_without_thickness(detector: Detector):
    square = Mesh.checked(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]]))
    assert detector.detect(square).point_group == "D4h"
    even = Mesh.checked(np.array([[0, 0, 0], [1, 0, 0], [0.5, 0.75**0.5, 0]]), np.array([[0, 1, 2]]))
    assert detector.detect(even).point_group == "D3h"


def test_nearly_spherical_and_nearly_square_shapes_give_no_swarm(detector: Detector):
    ball = trimesh.creation.icosphere(4)
    ball.vertices *= [1.0, 1.02, 1.04]
    detection = detector.detect(moved(of(ball), *pose(1)))
    assert detection.point_group == "D2h"
    assert len(detection.planes) == len(detection.axes) == 3
    detection = detector.detect(box(1.0, 1.03, 0.5))
    assert detection.point_group == "D2h"
    assert sum(plane.exact for plane in detection.planes) == 3
    # The diagonals hold within the threshold, and are told apart from what is exact.
    assert len(detection.planes) <= 5
    assert all(plane.symmetry_error > 1e-5 for plane in detection.planes if not plane.exact)


@pytest.mark.parametrize("name", ["chair", "orbit", "gear", "pyramid", "vase"])
def test_everything_returned_holds_on_fresh_samples(detector: Detector, name: str):
    shape = known(name, 1)
    mesh = moved(as_mesh(shape), *pose(3))
    detection = detector.detect(mesh)
    assert detection.point_group == shape.point_group
    assert detection.planes or detection.axes
    for element in [*detection.planes, *[axis for axis in detection.axes if axis.matrix is not None]]:
        error = fresh_error(mesh, element.matrix)
        assert error < MAX_ERROR
        if element.symmetry_error < 1e-12:
            assert error < 1e-12
        assert element.rms_distance == pytest.approx(detection.scale * element.symmetry_error**0.5)


@pytest.mark.parametrize("name", ["chair", "prism", "cyclic", "orbit"])
def test_a_moved_scaled_retessellated_copy_has_the_same_symmetries_moved_along(detector: Detector, name: str):
    mesh = as_mesh(known(name, 3))
    still = exact(detector.detect(mesh))
    rotation, move, scale = pose(4)
    for copy in (moved(mesh, rotation, move, scale), moved(subdivided(mesh), rotation, move, scale)):
        found = exact(detector.detect(copy))
        assert found.point_group == still.point_group
        assert len(found.planes) == len(still.planes)
        assert Counter(axis.order for axis in found.axes) == Counter(axis.order for axis in still.axes)
        normals = np.array([plane.normal for plane in found.planes]).reshape(-1, 3)
        assert (
            lines_off(normals, np.array([plane.normal for plane in still.planes]).reshape(-1, 3) @ rotation.T) < ANGLE
        )


def test_the_same_mesh_gives_the_same_answer_to_the_last_bit(detector: Detector):
    mesh = as_mesh(known("orbit", 2))
    first, second = detector.detect(mesh), detector.detect(mesh)
    assert [[*p.normal.tolist(), p.offset, p.symmetry_error] for p in first.planes] == [
        [*p.normal.tolist(), p.offset, p.symmetry_error] for p in second.planes
    ]
    assert [[*a.point.tolist(), a.symmetry_error] for a in first.axes] == [
        [*a.point.tolist(), a.symmetry_error] for a in second.axes
    ]


def test_doubled_faces_on_one_side_do_not_hide_the_plane(detector: Detector):
    mesh = as_mesh(known("chair"))
    centres = mesh.vertices[mesh.faces].mean(1)
    doubled = Mesh.checked(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[centres[:, 0] > 0]]))
    rotation, move, scale = pose(9)
    detection = detector.detect(moved(doubled, rotation, move, scale))
    plane = detection.planes[0]
    assert plane.exact
    assert np.linalg.norm(np.cross(plane.normal, rotation[:, 0])) < 1e-6
    assert abs(plane.normal @ move + plane.offset) < 1e-6 * detection.scale


def dominant_angle(detection: Detection, rotation: np.ndarray) -> float:
    return float(np.degrees(np.linalg.norm(np.cross(detection.planes[0].normal, rotation[:, 0]))))


@pytest.mark.parametrize("index", range(3))
def test_noise_and_missing_parts_leave_the_dominant_plane(detector: Detector, index: int):
    mesh = as_mesh(known("chair"))
    for damage, degrees in (("noisy", 0.5), ("partial", 0.1)):
        shown = corrupt(mesh.vertices, mesh.faces, damage, seed=1, index=index)
        # A hole of this size has an error of its own: the client says how much is acceptable.
        detection = detector.detect((shown.vertices, shown.faces), max_error=2e-3)
        assert dominant_angle(detection, shown.similarity.rotation) < degrees
        assert not detection.planes[0].exact
        assert 0.0 < detection.planes[0].rms_distance < 0.05 * detection.scale


def test_what_is_asymmetric_is_never_called_exact(detector: Detector):
    for seed in range(4):
        detection = detector.detect(as_mesh(known("none", seed)))
        assert not any(element.exact for element in [*detection.planes, *detection.axes])


def test_rejections_have_reasons(detector: Detector):
    detection = detector.detect(as_mesh(known("none", 3)))
    assert detection.rejected
    assert {item.reason for item in detection.rejected} == {"not_symmetric"}
    errors = [item.symmetry_error for item in detection.rejected]
    assert errors == sorted(errors)


def test_every_source_of_starts_is_enough_for_a_chair(detector: Detector):
    mesh = moved(as_mesh(known("chair")), *pose(2))
    for sources in (Sources(True, False, False), Sources(False, True, False), Sources(False, False, True)):
        assert detector.detect(mesh, sources=sources).point_group == "Cs"


def test_a_cylinder_in_bop_can_be_turned_over(detector: Detector):
    mesh = moved(
        as_mesh(known("cylinder", 1)), random_rotation(np.random.default_rng(3)), np.array([1.0, 2.0, 3.0]), 2.0
    )
    bop = detector.detect(mesh).bop()
    assert len(bop["symmetries_continuous"]) == 1
    assert len(bop["symmetries_discrete"]) == 1
    assert fresh_error(mesh, np.reshape(bop["symmetries_discrete"][0], (4, 4))) < 1e-6


def test_bop_lists_every_rotation_of_a_group_once(detector: Detector):
    bop = detector.detect(of(trimesh.creation.icosahedron())).bop()
    matrices = np.array(bop["symmetries_discrete"])
    assert len(matrices) == 59
    gaps = np.abs(matrices[:, None] - matrices[None]).max(2) + np.eye(59)
    assert gaps.min() > 0.1
