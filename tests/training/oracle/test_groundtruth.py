"""The exhaustive search: every plane, axis and order of shapes whose groups are known, and the file it writes."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from model.geometry.frames import UnitFrame
from model.geometry.sampling import sample_surface
from model.meshes.mesh import Mesh
from model.types import FloatArray
from tests.shapes import known, pose
from training.__main__ import app
from training.oracle import groundtruth as command
from training.oracle import known_truth
from training.oracle.alignment import Axes, Planes, Surface
from training.oracle.exhaustive import Settings
from training.oracle.groundtruth import find_symmetries, groundtruth
from training.oracle.known_truth import truth_of
from training.oracle.rotation_order import turn_of
from training.oracle.starts import extents, hemisphere
from training.oracle.truth import CLEAR_ERROR, Truth, TruthAxis, load, named, save
from training.shapes.catalogue import KnownShape, posed
from training.shapes.solids import loft, ring

QUICK = Settings(plane_starts=160, axis_starts=160, fine_samples=400, judge_samples=1000)
HUNDREDTH_DEGREE = np.deg2rad(0.01)


def angle_between(a: FloatArray, b: FloatArray) -> float:
    """Without regard to sign; exact for small angles too."""
    return float(np.arcsin(min(1.0, float(np.linalg.norm(np.cross(a, b))))))


def assert_complete(shape: KnownShape, truth: Truth) -> None:
    """Everything known of the shape is among what is clear, and nothing else."""
    frame = UnitFrame(truth.center, truth.scale)
    planes, axes = truth.clear_planes(), truth.clear_axes()
    endless = len(shape.continuous_axes)
    assert int(truth.plane_continuous.sum()) == {0: 0, 1: 2, 3: 3}[endless]
    assert len(planes) == len(shape.planes) + (2 if endless == 1 else 0)
    assert len(axes) == len(shape.axes)
    if endless == 3:  # a sphere: any three perpendicular ones
        directions = np.array([axis.direction for axis in axes])
        np.testing.assert_allclose(directions @ directions.T, np.eye(3), atol=1e-9)
        np.testing.assert_allclose(np.abs(planes[:, :3] @ directions.T).sum(0), 1.0, atol=1e-9)
        assert all(axis.order is None for axis in axes)
        return
    for row in shape.planes:
        offset = (row[3] + row[:3] @ frame.center) / frame.scale
        nearest = min(planes, key=lambda plane: angle_between(plane[:3], row[:3]))
        assert angle_between(nearest[:3], row[:3]) < HUNDREDTH_DEGREE
        assert abs(abs(nearest[3]) - abs(offset)) < 1e-4
    for axis in shape.axes:
        point = frame.to_unit(axis.point)
        nearest = min(axes, key=lambda other: angle_between(other.direction, axis.direction))
        assert angle_between(nearest.direction, axis.direction) < HUNDREDTH_DEGREE
        assert np.linalg.norm(np.cross(point - nearest.point, nearest.direction)) < 1e-4
        assert nearest.order == axis.order


@pytest.mark.parametrize(
    ("family", "parameters"),
    [
        ("prism", {"n": 3}),
        ("prism", {"n": 12}),
        ("prism", {"n": 24}),
        ("polyhedron", {"solid": "cube"}),
        ("polyhedron", {"solid": "icosahedron"}),
        ("polyhedron", {"solid": "tetrahedron"}),
        ("decorated", {"group": "T"}),
        ("dihedral", {"n": 5}),
        ("cyclic", {"n": 7}),
        ("improper", {"n": 3}),
        ("cylinder", {}),
        ("cone", {}),
        ("sphere", {}),
        ("none", {}),
    ],
)
def test_every_plane_axis_and_order_comes_out(family: str, parameters: dict[str, object]):
    shape = posed(known(family, **parameters), *pose(7))
    assert_complete(shape, find_symmetries(shape.vertices, shape.faces, QUICK))


def test_faces_that_lie_double_on_one_side_hide_nothing():
    """They shift the centroid of the area, but not the surface."""
    shape = known("prism", n=6)
    corners = shape.vertices[shape.faces]
    twice = shape.faces[corners.mean(1)[:, 0] > 0.1]
    doubled = replace(shape, faces=np.vstack([shape.faces, twice, twice]))
    truth = find_symmetries(doubled.vertices, doubled.faces, QUICK)
    assert abs(truth.center[0]) > 0.02
    assert_complete(doubled, truth)


def test_an_approximate_plane_is_listed_but_not_clear():
    shape = known("mirror")
    vertices = shape.vertices + np.random.default_rng(0).normal(0.0, 0.008, shape.vertices.shape)
    truth = find_symmetries(vertices, shape.faces, QUICK)
    assert not len(truth.clear_planes())
    assert CLEAR_ERROR < truth.plane_errors[0] < 1e-4
    assert angle_between(truth.planes[0, :3], shape.planes[0, :3]) < np.deg2rad(3.0)


@pytest.mark.parametrize(
    ("corners", "order"), [(5, 5), (20, 20), (24, 24), (27, 27), (28, None), (32, None), (96, None), (300, None)]
)
@pytest.mark.parametrize(("height", "top"), [(0.15, 0.3), (1.0, 1.0), (4.0, 0.3)])
def test_polygons_have_an_order_until_they_are_round(corners: int, order: int | None, height: float, top: float):
    vertices, faces = loft([ring(corners, 0.0), ring(corners, height, radius=top)])
    vertices = UnitFrame.of(vertices, faces).to_unit(vertices)
    few, many = (sample_surface(vertices, faces, count, seed=1)[0] for count in (160, 800))
    turn = turn_of(np.array([0.0, 0.0, 1.0]), np.zeros(3), few, many, Surface(vertices, faces), 4e-4)
    assert turn is not None
    assert turn.order == order
    tilted = np.array([0.6, 0.0, 0.8])
    wrong = turn_of(tilted, np.zeros(3), few, many, Surface(vertices, faces), 4e-4)
    assert wrong is None or wrong.error > 1e-5


def test_tangents_are_the_derivatives_of_the_images():
    rng = np.random.default_rng(0)
    samples, directions = rng.normal(size=(20, 3)), rng.normal(size=(4, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = np.cross(directions, rng.normal(size=(4, 3)))
    for moves, count in (
        (Planes(np.column_stack([directions, [0.1, 0.0, -0.2, 0.3]])), 3),
        (Axes(directions, points, rng.uniform(0.5, 3.0, (4, 1)), True), 5),
        (Axes(directions, points, rng.uniform(0.5, 3.0, (4, 20))), 4),
    ):
        for parameter in range(count):
            step = np.zeros((4, count))
            step[:, parameter] = 1e-6
            slope = (moves.moved(step).images(samples) - moves.moved(-step).images(samples)) / 2e-6
            np.testing.assert_allclose(slope, moves.tangents(samples)[:, :, parameter], atol=1e-8)


def test_hemisphere_is_even():
    directions = hemisphere(200)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    cosines = np.abs(directions @ directions.T) - 2 * np.eye(200)
    nearest = np.degrees(np.arccos(cosines.max(1)))
    assert nearest.min() > 3.0
    assert nearest.max() < 12.0


def test_the_centre_of_the_smallest_ball_ignores_how_points_are_spread():
    points = np.vstack([np.eye(3), -np.eye(3), np.tile([0.5, 0.2, 0.1], (50, 1))]) + 2.0
    low, high, centre = extents(points, np.eye(3))
    np.testing.assert_allclose(low, 1.0)
    np.testing.assert_allclose(high, 3.0)
    np.testing.assert_allclose(centre, 2.0, atol=0.01)


def test_the_file_returns_what_was_saved(tmp_path: Path):
    truth = Truth(
        center=np.array([0.1, 0.2, 1 / 3]),
        scale=7.0,
        planes=np.array([[0.6, 0.8, 0.0, 0.25], [0.0, 0.0, 1.0, 0.0]]),
        plane_errors=np.array([0.0, 2e-5]),
        plane_continuous=np.array([True, False]),
        axes=[TruthAxis(np.array([0.0, 0.0, 1.0]), np.zeros(3), None, 1e-9)],
    )
    save(tmp_path / "truth.json", {"a/b.ply": truth}, {"starts": 3}, "0" * 64)
    document = json.loads((tmp_path / "truth.json").read_text())
    assert (document["manifest_sha256"], document["settings"]) == ("0" * 64, {"starts": 3})
    again = load(tmp_path / "truth.json")["a/b.ply"]
    np.testing.assert_array_equal(again.planes, truth.planes)
    np.testing.assert_array_equal(again.center, truth.center)
    np.testing.assert_array_equal(again.plane_continuous, truth.plane_continuous)
    np.testing.assert_array_equal(again.clear_planes(), truth.planes[:1])
    assert again.axes[0].order is None
    assert len(again.clear_axes()) == 1


def test_shapes_are_known_from_the_file_of_a_folder_above():
    shape = Truth(np.zeros(3), 1.0, np.zeros((0, 4)), np.zeros(0), np.zeros(0, dtype=np.bool_))
    known = {
        name: replace(shape, scale=float(row)) for row, name in enumerate(("all/a/x.ply", "all/b/x.ply", "b/y.ply"))
    }
    found = named(known, ["a/x.ply", "x.ply", "b/y.ply", "all/b/x.ply", "c/x.ply", "y.ply"])
    # x.ply is two, c/x.ply and y.ply are files of other folders.
    assert {name: truth.scale for name, truth in found.items()} == {"a/x.ply": 0.0, "b/y.ply": 2.0, "all/b/x.ply": 1.0}


def test_what_is_known_of_another_mesh_is_not_taken(monkeypatch: pytest.MonkeyPatch):
    solid = known("box")
    mesh = Mesh.checked(solid.vertices, solid.faces)
    frame = UnitFrame.of(mesh.vertices, mesh.faces)
    nothing = Truth(frame.center, frame.scale, np.zeros((0, 4)), np.zeros(0), np.zeros(0, dtype=np.bool_))
    searched = replace(nothing)
    monkeypatch.setattr(known_truth, "find_symmetries", lambda *mesh: searched)
    assert truth_of(Path("box.ply"), mesh, frame, nothing)[0] is nothing
    assert truth_of(Path("box.ply"), mesh, frame, replace(nothing, scale=1.1 * frame.scale))[0] is searched
    assert truth_of(Path("box.ply"), mesh, frame, replace(nothing, center=frame.center + 0.1))[0] is searched


def test_a_run_is_resumed_and_skips_what_cannot_be_read(
    mesh_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder = tmp_path / "meshes"
    folder.mkdir()
    for seed in ("00", "01"):
        (folder / f"box{seed}.obj").write_bytes((mesh_folder / "box" / f"{seed}.obj").read_bytes())
    (folder / "broken.obj").write_text("v 0 0 0\nf 1 2 3\n")
    out, part = tmp_path / "out" / "truth.json", tmp_path / "out" / "truth.json.part"
    small = replace(QUICK, plane_starts=60, axis_starts=60)
    search = command.find_symmetries

    def fail_on_second(*arguments: object) -> Truth:
        if part.read_text().count("\n") == 2:
            raise KeyboardInterrupt
        return search(*arguments)

    monkeypatch.setattr(command, "find_symmetries", fail_on_second)
    with pytest.raises(KeyboardInterrupt):
        groundtruth([folder], out, small, progress=False)
    monkeypatch.undo()
    with pytest.raises(ValueError, match="other settings"):
        groundtruth([folder], out, QUICK, progress=False)
    assert groundtruth([folder], out, small, progress=False) == (2, 2, 1)
    assert not part.exists()
    truths = load(out)
    assert set(truths) == {"meshes/box00.obj", "meshes/box01.obj"}
    for truth in truths.values():
        assert len(truth.clear_planes()) == 3
        assert [axis.order for axis in truth.clear_axes()] == [2, 2, 2]


def test_the_command_refuses_what_is_no_folder(tmp_path: Path):
    result = CliRunner().invoke(app, ["groundtruth", str(tmp_path / "missing"), "-o", str(tmp_path / "x.json")])
    assert result.exit_code == 2
    assert "not a folder" in " ".join(result.output.replace("│", " ").split())
