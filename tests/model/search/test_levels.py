"""Levels: one group that agrees with itself, what breaks it, and what is missing is not different."""

from collections import Counter

import numpy as np
import pytest
import trimesh

from model import Detection, Detector, Mesh
from model.geometry.frames import UnitFrame
from model.search.point_groups import contains, point_group
from tests.shapes import as_mesh, box, known, moved, pose
from training.evaluation.corruptions import add_noise, cut_ball, decimate

COSINE = np.cos(np.deg2rad(0.02))


@pytest.fixture(scope="module")
def detector() -> Detector:
    return Detector.load()


def together(*boxes: tuple[list[float], list[float]]) -> Mesh:
    """Boxes by their extents and centres, as one mesh."""
    parts = [trimesh.creation.box(extents).apply_translation(centre) for extents, centre in boxes]
    whole = trimesh.util.concatenate(parts)
    return Mesh.checked(np.array(whole.vertices), np.array(whole.faces))


def studded(corners: list[tuple[int, int]]) -> Mesh:
    """A plate with studs near some of its corners."""
    studs = [([1.2, 1.2, 1.5], [4.0 * x, 2.0 * y, 1.25]) for x, y in corners]
    return together(([10.0, 6.0, 1.0], [0.0, 0.0, 0.0]), *studs)


def matrices(detection: Detection) -> np.ndarray:
    """Linear parts of all planes and of all rotations about all axes."""
    found = [plane.matrix[:3, :3] for plane in detection.planes]
    for axis in detection.axes:
        if axis.order is not None:
            turn = axis.matrix[:3, :3]
            found += [np.linalg.matrix_power(turn, k) for k in range(1, axis.order)]
    return np.array(found).reshape(-1, 3, 3)


def assert_agrees_with_itself(detection: Detection) -> None:
    """Planes and axes are exactly those of the point group, and products of them are members, too."""
    group = point_group(detection.point_group)
    assert len(detection.planes) == len(group.normals)
    assert Counter(axis.order or 0 for axis in detection.axes) == Counter(group.orders)
    chosen = [level for level in detection.levels if level.chosen]
    assert [level.point_group for level in chosen] == [detection.point_group] * (detection.point_group != "C1")
    members = matrices(detection)
    if not len(group.matrices) or not len(members):
        return
    known_traces = np.round(np.trace(group.matrices, axis1=1, axis2=2), 6)
    products = np.einsum("aij,bjk->abik", members, members).reshape(-1, 3, 3)
    # Every product is of a kind that the group has; and there are no more of them than the group has members.
    assert np.isin(np.round(np.trace(products, axis1=1, axis2=2), 6), known_traces).all()
    distinct: list[np.ndarray] = []
    for product in products:
        if not any(np.trace(product.T @ other) > 1.0 + 2.0 * COSINE for other in distinct):
            distinct.append(product)
    assert len(distinct) <= len(group.matrices)


FAMILIES = ["box", "prism", "antiprism", "cyclic", "dihedral", "pyramid", "chair", "table", "cone", "vase", "sphere"]


@pytest.mark.parametrize("family", FAMILIES)
def test_answers_agree_with_themselves_whatever_is_wrong_with_the_shape(detector: Detector, family: str) -> None:
    rng = np.random.default_rng(FAMILIES.index(family))
    shape = moved(as_mesh(known(family, 2)), *pose(11))
    for damage in (None, add_noise, cut_ball, decimate):
        if damage is None:
            vertices, faces = shape.vertices, shape.faces
        elif damage is decimate:
            vertices, faces = decimate(shape.vertices, shape.faces)
        else:
            vertices, faces = damage(shape.vertices, shape.faces, rng)
        assert_agrees_with_itself(detector.detect((vertices, faces)))


def test_random_soups_agree_with_themselves(detector: Detector) -> None:
    for seed in range(6):
        rng = np.random.default_rng(seed)
        vertices = rng.normal(size=(30, 3)) * [1.0, 1.0, 10.0 ** -(seed % 3)]
        faces = rng.integers(0, 30, (40, 3))
        assert_agrees_with_itself(detector.detect((vertices, faces[(np.diff(np.sort(faces, axis=1)) > 0).all(1)])))


@pytest.mark.parametrize(("family", "group"), [("box", "D2h"), ("prism", "D5h"), ("pyramid", "C5v"), ("cone", "Cinfv")])
def test_noise_and_decimation_leave_the_group(detector: Detector, family: str, group: str) -> None:
    parameters = {} if group in ("D2h", "Cinfv") else {"n": 5}
    shape = moved(as_mesh(known(family, 3, **parameters)), *pose(5))
    noisy = add_noise(shape.vertices, shape.faces, np.random.default_rng(1))
    for mesh in (noisy, decimate(*noisy)):
        detection = detector.detect(mesh)
        assert detection.point_group == group
        assert not any(element.exact for element in [*detection.planes, *detection.axes])


def test_a_missing_stud_breaks_the_group_and_is_named(detector: Detector) -> None:
    whole = detector.detect(studded([(-1, -1), (-1, 1), (1, -1), (1, 1)]))
    assert whole.point_group == "C2v"
    assert all(plane.exact for plane in whole.planes)
    assert whole.levels[-1].breaks == []
    rotation, move, scale = pose(2)
    mesh = moved(studded([(-1, -1), (-1, 1), (1, -1)]), rotation, move, scale)
    detection = detector.detect(mesh)
    assert detection.point_group == "C2v"
    assert not any(element.exact for element in [*detection.planes, *detection.axes])
    level = next(level for level in detection.levels if level.chosen)
    assert level.exact is False
    corners = [
        scale * rotation @ np.array([4.0 * x, 2.0 * y, 0.75]) + move for x, y in ((-1, -1), (-1, 1), (1, -1), (1, 1))
    ]
    assert level.breaks
    for patch in level.breaks:
        assert min(np.linalg.norm(patch.center - corner) for corner in corners) < scale
    assert level.breaks[0].max_distance == pytest.approx(1.5 * scale, rel=0.1)
    assert detector.detect(mesh, level="exact").point_group in ("C1", "Cs")  # a diagonal of a plate that is no square


def test_a_level_is_chosen_by_tolerance(detector: Detector) -> None:
    mesh = studded([(-1, -1), (-1, 1), (1, -1)])
    needed = max(level.rms_distance for level in detector.detect(mesh).levels if level.point_group == "C2v")
    assert needed > 0.0
    assert detector.detect(mesh, tolerance=1.01 * needed).point_group == "C2v"
    assert detector.detect(mesh, tolerance=0.5 * needed).point_group == "C1"


def test_what_is_exact_of_a_broken_group_is_a_level(detector: Detector) -> None:
    corners = [(x, y) for x in (-1, 1) for y in (-1, 1)]
    plate = studded(corners)
    label = trimesh.creation.box([0.3, 0.3, 0.02]).apply_translation([3.0, 0.0, 0.505])
    whole = trimesh.util.concatenate([trimesh.Trimesh(plate.vertices, plate.faces, process=False), label])
    mesh = Mesh.checked(np.array(whole.vertices), np.array(whole.faces))
    detection = detector.detect(mesh)
    assert [(level.point_group, level.exact) for level in detection.levels] == [("Cs", True), ("C2v", False)]
    exact = detector.detect(mesh, level="exact")
    assert exact.point_group == "Cs"
    assert exact.planes[0].exact
    np.testing.assert_allclose(np.abs(exact.planes[0].normal), [0.0, 1.0, 0.0], atol=1e-6)


def test_a_label_is_seen_however_small(detector: Detector) -> None:
    height = 0.02
    labelled = together(([10.0, 6.0, 2.0], [0, 0, 0]), ([1.0, 0.3, height], [2.0, 1.5, 1.0 + height / 2]))
    detection = detector.detect(labelled)
    assert detection.point_group == "D2h"
    assert not any(plane.exact for plane in detection.planes)
    assert max(plane.max_distance for plane in detection.planes) == pytest.approx(height, rel=0.01)
    patches = next(level for level in detection.levels if level.chosen).breaks
    assert all(np.linalg.norm(patch.center[:2] - [2.0, 1.5]) < 0.6 for patch in patches)
    assert all(plane.exact for plane in detector.detect(box(10.0, 6.0, 2.0)).planes)


def test_bores_of_different_facets_are_the_same_bore(detector: Detector) -> None:
    def tube(segments: int, x: float) -> trimesh.Trimesh:
        return trimesh.creation.annulus(0.5, 1.0, 1.0, sections=segments).apply_translation([x, 0.0, 0.0])

    parts = trimesh.util.concatenate([trimesh.creation.box([8.0, 3.0, 0.4]), tube(24, -2.5), tube(17, 2.5)])
    detection = detector.detect((np.array(parts.vertices), np.array(parts.faces)))
    assert detection.point_group == "D2h"
    assert all(plane.exact for plane in detection.planes)
    assert max(plane.symmetry_error for plane in detection.planes) > 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_a_hole_is_missing_and_not_different(detector: Detector, seed: int) -> None:
    shape = moved(as_mesh(known("prism", 1, n=6)), *pose(8))
    cut = cut_ball(shape.vertices, shape.faces, np.random.default_rng(seed))
    intact, detection = detector.detect(shape), detector.detect(cut)
    assert detection.point_group == intact.point_group == "D6h"
    assert all(plane.symmetry_error < 1e-6 for plane in detection.planes)
    assert min(plane.coverage for plane in detection.planes) < 0.98
    frame = UnitFrame.of(shape.vertices, shape.faces)
    for plane in detection.planes:
        closest = max(intact.planes, key=lambda other: abs(other.normal @ plane.normal))
        assert abs(closest.normal @ plane.normal) > np.cos(np.deg2rad(0.2))
        assert abs(plane.normal @ frame.center + plane.offset) < 5e-3 * frame.scale


def test_an_open_end_is_no_missing_lid(detector: Detector) -> None:
    cup = trimesh.creation.cylinder(1.0, 2.5, sections=64)
    open_faces = np.array(cup.faces)[np.array(cup.triangles_center)[:, 2] < 1.249]
    detection = detector.detect((np.array(cup.vertices), open_faces))
    assert detection.point_group == "Cinfv"


def test_members_are_told_up_to_an_angle() -> None:
    group = point_group("D6h")
    turn = trimesh.transformations.rotation_matrix(np.deg2rad(60.5), [0, 0, 1])[:3, :3]
    assert contains(group, turn[None], np.deg2rad(1.0))[0]
    assert not contains(group, turn[None], np.deg2rad(0.1))[0]
