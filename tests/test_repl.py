"""What a person sees who tries the package in a REPL or a notebook, and that objects of trimesh go in and come out."""

import html
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

import app
import model
from app.cli.commands import app as commands
from model.formats.conversion import as_mesh
from tests.shapes import box

DATA = Path(__file__).parent / "data"


@pytest.mark.parametrize("package", [app, model])
def test_dir_lists_the_public_names_and_all_of_them_are_there(package):
    listed = dir(package)
    assert {*package.__all__, "__version__"} == set(listed)
    assert all(getattr(package, name) is not None for name in listed)
    assert Path(package.__file__).with_name("py.typed").is_file()


@pytest.mark.parametrize("find", [app.detect, lambda mesh: model.Detector.load().detect(as_mesh(mesh))])
def test_a_result_is_one_line_and_a_table(find):
    result = find(box(1, 2, 3))
    assert repr(result) == str(result) == f"<{type(result).__name__}: D2h, 3 planes, 3 axes, 6 of 6 exact>"
    rows = re.findall(r"<tr><td>(plane|axis)</td><td>\(([^)]*)\)</td>", result._repr_html_())
    shown = [np.array(vector.split(", "), dtype=float) for _, vector in rows]
    found = [plane.normal for plane in result.planes] + [axis.direction for axis in result.axes]
    assert [kind for kind, _ in rows] == ["plane"] * 3 + ["axis"] * 3
    assert np.abs(np.array(shown) - np.array(found)).max() < 1e-6


def test_text_from_a_file_is_no_markup():
    result = app.detect(DATA / "chair.obj")
    named = result.model_copy(update={"mesh": result.mesh.model_copy(update={"filename": "<script>.obj"})})
    assert "<script>" not in named._repr_html_()
    assert html.escape("<script>.obj") in named._repr_html_()
    assert repr(named).startswith("<DetectResponse <script>.obj: Cs, 1 plane, 0 axes, ")


def test_meshes_of_trimesh_go_in_and_come_out():
    mesh = as_mesh(DATA / "table.glb")
    out = mesh.to_trimesh()
    assert np.array_equal(out.vertices, mesh.vertices)
    assert np.array_equal(out.faces, mesh.faces)
    assert out.units == mesh.units == "meter"
    out.vertices[:] = 0.0
    assert np.ptp(mesh.vertices) > 0.0  # a copy
    whole = mesh.to_trimesh()
    for found in app.detect(whole).planes:
        mirrored = whole.copy().apply_transform(found.matrix)
        assert np.abs(mirrored.bounds - whole.bounds).max() < 1e-6
    completed = app.complete(trimesh.creation.box((1, 2, 3)), plane=[1.0, 0.0, 0.0, 0.0]).to_trimesh()
    assert completed.volume == pytest.approx(6.0)


def test_the_command_tells_its_version():
    result = CliRunner().invoke(commands, ["--version"])
    assert (result.exit_code, result.stdout.strip()) == (0, f"prsnet {model.__version__}")
