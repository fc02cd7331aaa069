"""The lines for simulation programs say what the numbers beside them say."""

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

import app
from app import editing, local
from app.edit_schemas import Half
from app.outputs.fem import half_with_lines
from model import Detector
from model.errors import NoAxisError
from model.formats.conversion import as_mesh
from model.geometry.transforms import rotation_matrix
from model.meshes.mesh import Mesh

TURN = rotation_matrix(np.array([1.0, 2.0, 2.0]) / 3.0, 0.8)


@pytest.fixture(scope="module", autouse=True)
def real_weights() -> None:
    local.detector_of.cache_clear()


def prism(order: int, turn: np.ndarray = TURN) -> Mesh:
    solid = trimesh.creation.cylinder(1.0, 3.0, sections=order)
    return Mesh.checked(solid.vertices @ turn.T + [10.0, 20.0, 30.0], solid.faces)


def numbers(line: str) -> list[float]:
    return [float(word) for word in line.split(",")]


def test_lines_of_a_sector() -> None:
    made = app.sector(prism(7))
    sector, lines = made.sector, made.sector.calculix.splitlines()
    assert (sector.order, sector.capped, sector.detected) == (7, True, True)
    at = lines.index("*CYCLIC SYMMETRY MODEL, N=7, NGRAPH=7, TIE=CYCLIC")
    assert lines[at - 1] == "DEPENDENT, INDEPENDENT"
    assert re.fullmatch(r"\*TIE, NAME=CYCLIC, CYCLIC SYMMETRY, POSITION TOLERANCE=[\d.e-]+", lines[at - 2])
    ends = np.array(numbers(lines[at + 1])).reshape(2, 3)
    np.testing.assert_allclose(ends, sector.ends, rtol=1e-11)
    axis = TURN @ [0.0, 0.0, 1.0]
    np.testing.assert_allclose(np.abs((ends[1] - ends[0]) @ axis), 3.0, atol=1e-6)
    np.testing.assert_allclose(np.cross(ends - [10.0, 20.0, 30.0], axis), 0.0, atol=1e-6)
    # From the dependent to the independent plane is a turn about the way from the first end to the second.
    turn = rotation_matrix(np.array(sector.direction), np.radians(sector.angle))
    np.testing.assert_allclose(turn @ sector.dependent.normal, -np.array(sector.independent.normal), atol=1e-12)
    assert (ends[1] - ends[0]) @ sector.direction > 0.0
    assert all(len(line) <= 132 for line in lines)  # what CalculiX reads of one
    assert "tie.Sectors = 7" in sector.freecad
    compile(sector.freecad, "console", "exec")


@pytest.mark.parametrize("normal", [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.6, 0.0, 0.8], [-2.0, 1.0, 2.0]])
def test_lines_of_a_half_hold_the_nodes_in_its_plane(normal: list[float]) -> None:
    unit = np.array(normal) / np.linalg.norm(normal)
    plane = [*unit, -unit @ [10.0, 20.0, 30.0]]
    detector = Detector.load("default")
    answer, mesh = editing.halve_mesh(detector, prism(6), "", editing.HalveOptions(plane, capped=True), 0.0, 0.0)
    half = half_with_lines(answer.half)
    assert half.capped
    assert mesh.watertight
    points = np.array(half.points)
    np.testing.assert_allclose(points @ unit + plane[3], 0.0, atol=1e-9)
    assert np.linalg.norm(np.cross(points[1] - points[0], points[2] - points[0])) > 1.0
    lines = half.calculix.splitlines()
    *_, degree = (int(word) for word in lines[-1].split(",")[1:])
    local_axes = np.eye(3)
    if any(line.startswith("*TRANSFORM") for line in lines):
        first, second = np.array(numbers(lines[lines.index("*BOUNDARY") - 1])).reshape(2, 3)
        np.testing.assert_allclose([first @ second, second @ second], [0.0, 1.0], atol=1e-9)
        local_axes = np.stack([first, second, np.cross(first, second)])
    np.testing.assert_allclose(np.abs(local_axes[degree - 1] @ unit), 1.0, atol=1e-9)  # held across the plane alone
    compile(half.freecad, "console", "exec")
    assert f"fix.{'xyz'[degree - 1]}Free = False" in half.freecad


def test_lines_are_no_secret_of_the_worker() -> None:
    assert (Half.model_fields["calculix"].default, Half.model_fields["freecad"].default) == ("", "")


def test_which_axis_sectors_are_cut_about(tmp_path: Path) -> None:
    six = prism(6)
    assert [app.sector(six, order=n).sector.order for n in (2, 3, 6)] == [2, 3, 6]
    with pytest.raises(NoAxisError, match=r"an order that 4 divides: the axes have the orders 6, 2"):
        app.sector(six, order=4)
    can = trimesh.creation.cylinder(1.0, 3.0, sections=512)
    with pytest.raises(NoAxisError, match="Give an order"):
        app.sector(can)
    assert app.sector(can, order=12).sector.angle == 30.0
    with pytest.raises(NoAxisError, match="larger max_error, or axis, point and order"):
        app.sector(Path(__file__).parents[2] / "data" / "chair.obj")
    with pytest.raises(ValueError, match="axis: needs order"):
        app.sector(six, axis=[0.0, 0.0, 1.0])
    with pytest.raises(ValueError, match="start: lies along the axis"):
        app.sector(six, axis=[0.0, 0.0, 1.0], order=3, start=[0.0, 0.0, -2.0])
    made = app.sector(six, axis=list(TURN @ [0.0, 0.0, 1.0]), point=[10.0, 20.0, 30.0], order=6)
    assert not made.sector.detected
    made.save(tmp_path / "s.glb")
    assert 6.0 * as_mesh(tmp_path / "s.glb").to_trimesh().volume == pytest.approx(six.to_trimesh().volume, rel=1e-5)
    assert made.to_trimesh().is_watertight
