"""Held-out shapes come out as meshes whose written truth is true, and `evaluate` takes both."""

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from model.formats import read_mesh
from model.geometry.frames import UnitFrame
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect
from training.__main__ import app
from training.data.heldout import write_held_out
from training.data.labels import Options, label
from training.data.prepared import PreparedSet
from training.oracle.truth import load

SHARE = 0.3


@pytest.fixture(scope="module")
def labelled(prepared: PreparedSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A prepared set of its own: labels are written into it."""
    root = tmp_path_factory.mktemp("labelled") / "set"
    shutil.copytree(prepared.root, root)
    label(PreparedSet(root), Options(), progress=False)
    return root


def test_the_planes_written_are_symmetries_of_the_meshes_written(labelled: Path, tmp_path: Path):
    count = write_held_out(PreparedSet(labelled), tmp_path / "held", SHARE)
    truth = load(tmp_path / "held" / "truth.json")
    held_out = PreparedSet(labelled).split(SHARE)[1]
    assert count == len(truth) == len(held_out) > 3
    judged = 0
    for name, known in truth.items():
        file = tmp_path / name
        mesh = read_mesh(file.read_bytes(), file.name)
        vertices = UnitFrame.of(mesh.vertices, mesh.faces).to_unit(mesh.vertices)
        surface = SurfaceIndex(vertices, mesh.faces)
        samples, _ = sample_surface(vertices, mesh.faces, 500, seed=5)
        for plane in known.planes:
            assert surface.mean_squared_distance(reflect(samples, plane)) < 5e-4, name
            judged += 1
    assert judged > 3


def test_a_limit_draws_the_same_shapes_every_time(labelled: Path, tmp_path: Path):
    assert write_held_out(PreparedSet(labelled), tmp_path / "a", SHARE, 2) == 2
    write_held_out(PreparedSet(labelled), tmp_path / "b", SHARE, 2)
    names = [sorted(file.name for file in (tmp_path / folder).iterdir()) for folder in "ab"]
    assert names[0] == names[1]


def test_evaluate_judges_on_them(labelled: Path, tmp_path: Path):
    runner = CliRunner()
    written = runner.invoke(app, ["heldout", str(labelled), "-o", str(tmp_path / "held"), "--share", str(SHARE)])
    assert written.exit_code == 0, written.output
    told = ["--groundtruth", str(tmp_path / "held" / "truth.json"), "--methods", "raw", "--no-progress"]
    judged = runner.invoke(app, ["evaluate", str(tmp_path / "held"), *told])
    assert judged.exit_code == 0, judged.output
    assert "raw network: median wall-clock milliseconds" in judged.output
    judged = runner.invoke(app, ["evaluate", str(tmp_path / "held"), *told, "--markdown"])
    assert "| raw network |" in judged.output


def test_labels_are_needed(prepared: PreparedSet, tmp_path: Path):
    assert prepared.labels is None
    told = CliRunner().invoke(app, ["heldout", str(prepared.root), "-o", str(tmp_path / "held")])
    assert told.exit_code == 2
    assert "training label" in told.output
    assert not list(tmp_path.iterdir())
