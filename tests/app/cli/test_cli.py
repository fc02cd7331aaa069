"""The command line, in process, with a detector whose answer is known."""

import csv
import io
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from typer.testing import CliRunner

from app import detection, local, schemas
from app.cli.commands import app
from app.cli.inputs import expand
from app.http import server
from app.outputs import bop
from app.settings import Settings
from model.errors import CheckpointError, NoPlaneError
from tests.app.fakes import DATA, FakeDetector

runner = CliRunner()
ONE = ["--jobs", "1"]  # other processes would not know the detector of these tests


@pytest.fixture(autouse=True)
def served(monkeypatch: pytest.MonkeyPatch, detector: FakeDetector) -> Iterator[FakeDetector]:
    def load(weights: str) -> FakeDetector:
        if weights == "broken.safetensors":
            raise CheckpointError("The weights file is damaged.")
        return detector

    monkeypatch.setattr(detection, "load_detector", load)
    local.detector_of.cache_clear()
    yield detector
    local.detector_of.cache_clear()


def test_json_of_one_file_is_an_object_and_of_several_a_list() -> None:
    result = runner.invoke(app, ["detect", "--json", str(DATA / "chair.obj")])
    assert result.exit_code == 0
    answer = schemas.DetectResponse.model_validate_json(result.stdout)
    assert answer.mesh.filename == "chair.obj"
    assert set(json.loads(result.stdout)).isdisjoint({"bop", "rejected"})
    names = [str(DATA / "chair.obj"), str(DATA / "plant.off")]
    result = runner.invoke(app, ["detect", "--json", "--rejected", *ONE, *names])
    assert [item["mesh"]["filename"] for item in json.loads(result.stdout)] == names
    assert json.loads(result.stdout)[0]["rejected"]


def test_jsonl_is_an_answer_a_line() -> None:
    result = runner.invoke(app, ["detect", "--jsonl", *ONE, str(DATA / "chair.obj"), str(DATA / "plant.off")])
    assert result.exit_code == 0
    answers = [schemas.DetectResponse.model_validate_json(line) for line in result.stdout.splitlines()]
    assert [answer.mesh.faces for answer in answers] == [260, 245]


def test_csv_and_bop() -> None:
    result = runner.invoke(app, ["detect", "--csv", *ONE, str(DATA / "chair.obj"), str(DATA / "plant.off")])
    rows = list(csv.DictReader(io.StringIO(result.stdout)))
    assert [(Path(row["file"]).name, row["kind"]) for row in rows] == [
        (name, kind) for name in ("chair.obj", "plant.off") for kind in ("plane", "axis", "axis")
    ]
    result = runner.invoke(app, ["detect", "--bop", *ONE, str(DATA / "chair.obj"), str(DATA / "plant.off")])
    entries = json.loads(result.stdout)
    assert list(entries) == ["chair", "plant"]
    assert len(entries["chair"]["symmetries_discrete"]) == len(entries["plant"]["symmetries_continuous"]) == 1
    assert bop.model_id(Path("models/obj_000012.ply")) == "12"
    assert bop.model_id(Path("obj_twelve.ply")) == "obj_twelve"


def test_every_format_of_the_service_that_is_text_can_be_printed() -> None:
    result = runner.invoke(app, ["detect", "--format", "shrec", str(DATA / "chair.obj")])
    assert result.exit_code == 0
    assert result.stdout.splitlines()[0] == "1"
    for arguments, words in (
        (["--format", "shrec", str(DATA / "chair.obj"), str(DATA / "plant.off")], "one mesh"),
        (["--format", "glb", str(DATA / "chair.obj")], "table, jsonl, json, bop, foundationpose, csv, shrec"),
        (["--format", "csv", "--json", str(DATA / "chair.obj")], "at most one"),
    ):
        result = runner.invoke(app, ["detect", *ONE, *arguments])
        assert result.exit_code == 2
        assert words in " ".join(result.stderr.replace("│", " ").split())


def test_pictures_and_annotated_meshes_are_written_beside_the_table(tmp_path: Path) -> None:
    out = tmp_path / "new" / "folder"
    arguments = ["detect", "--glb", "--png", "--up", "y", "-o", str(out), str(DATA / "chair.obj")]
    result = runner.invoke(app, arguments)
    assert result.exit_code == 0, result.stderr
    assert "chair.obj" in result.stdout
    scene = trimesh.load(out / "chair-symmetries.glb")
    assert sorted(scene.graph.nodes_geometry) == ["axis 0", "axis 1", "mesh", "plane 0"]
    picture = np.asarray(Image.open(out / "chair-symmetries.png")).astype(float)
    assert picture.shape == (800, 800, 3)
    blue = (picture[..., 2] > picture[..., 0] + 20).mean()
    white = (picture == 255).all(axis=2).mean()
    assert 0.05 < blue < 0.8  # the plane, with the chair in it
    assert 0.1 < white < 0.9


def test_names_folders_and_patterns(tmp_path: Path) -> None:
    for name in ("b/x.OBJ", "b/c/y.stl", "a.ply", "notes.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "empty").mkdir()
    root = str(tmp_path)

    def found(*names: str) -> list[str]:
        return [path.relative_to(tmp_path).as_posix() for path in expand([f"{root}{name}" for name in names])[0]]

    assert found("") == ["a.ply", "b/c/y.stl", "b/x.OBJ"]
    assert found("/**/*.stl", "/a.ply", "/*.ply") == ["b/c/y.stl", "a.ply"]
    assert found("/notes.txt", "/missing.obj") == ["notes.txt", "missing.obj"]
    _, nothing = expand([f"{root}/empty", f"{root}/*.off"])
    assert [path.name for path, _ in nothing] == ["empty", "*.off"]


def test_a_half_is_completed(tmp_path: Path, served: FakeDetector) -> None:
    half, whole = tmp_path / "half.ply", tmp_path / "whole.stl"
    result = runner.invoke(app, ["halve", str(DATA / "chair.obj"), "-o", str(half)])
    assert result.exit_code == 0, result.stderr
    assert trimesh.load(half).bounds[0, 0] == pytest.approx(0.0, abs=1e-9)
    other = runner.invoke(app, ["halve", str(DATA / "chair.obj"), "--other", "-o", str(tmp_path / "other.obj")])
    assert other.exit_code == 0
    assert trimesh.load(tmp_path / "other.obj").bounds[1, 0] == pytest.approx(0.0, abs=1e-9)
    result = runner.invoke(app, ["complete", str(half), "-o", str(whole), "--normal", "3,0,0"])
    assert result.exit_code == 0, result.stderr
    assert "100.0 % of the surface" in result.stdout
    assert trimesh.load(whole).area == pytest.approx(trimesh.load(DATA / "chair.obj", force="mesh").area, rel=1e-5)
    served.failure = NoPlaneError("No mirror plane.")
    result = runner.invoke(app, ["complete", str(half), "-o", str(whole), "--overwrite"])
    assert result.exit_code == 1
    assert "half.ply: No mirror plane." in result.stderr


def test_table_is_readable(served: FakeDetector) -> None:
    result = runner.invoke(app, ["detect", str(DATA / "chair.obj"), "--mode", "paper", "--max-error", "1e-3"])
    assert result.exit_code == 0
    for expected in ("chair.obj", "260 faces", "Cs", "(1.0000, 0.0000, 0.0000)", "any angle", "a warning"):
        assert expected in result.stdout
    assert served.calls[0]["mode"] == "paper"
    assert served.calls[0]["max_error"] == 1e-3


def test_failed_files_do_not_stop_the_others(tmp_path: Path) -> None:
    broken = tmp_path / "broken.obj"
    broken.write_bytes(b"\x00\xff nothing")
    files = [str(broken), str(tmp_path / "missing.obj"), str(DATA / "chair.obj")]
    result = runner.invoke(app, ["detect", "--jsonl", *ONE, *files])
    assert result.exit_code == 1
    assert len(result.stdout.splitlines()) == 1
    assert result.stderr.startswith("2 of 3 failed:")
    assert "broken.obj: " in result.stderr
    assert "missing.obj: No such file" in result.stderr
    assert runner.invoke(app, ["detect", str(broken), str(tmp_path / "*.stl"), *ONE]).exit_code == 3


@pytest.mark.parametrize(
    "arguments",
    [
        ["detect"],
        ["detect", "--mode", "quick", "a.obj"],
        ["detect", "--json", "--csv", "a.obj"],
        ["detect", "--png", "--up", "x", "a.obj"],
        ["detect", "--jobs", "-1", "a.obj"],
        ["complete", "a.obj"],
        ["complete", "a.obj", "-o", "b.off"],
        ["complete", "a.obj", "-o", "b.ply", "--normal", "1,2"],
        ["complete", "a.obj", "-o", "b.ply", "--max-error", "2"],
        ["halve", "a.obj", "-o", "b.3mf"],
        ["detect", "--max-error", "0", "a.obj"],
        ["detect", "--max-error", "nan", "a.obj"],
        ["detect", "--weights", "broken.safetensors", "a.obj"],
        ["serve", "--port", "70000"],
        ["serve", "--workers", "0"],
        ["explode"],
    ],
)
def test_wrong_usage_is_exit_code_2(arguments: list[str]) -> None:
    assert runner.invoke(app, arguments).exit_code == 2


def test_serve_prefers_options_over_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Settings] = []

    def serve(settings: Settings) -> int:
        seen.append(settings)
        return 1

    monkeypatch.setattr(server, "serve", serve)
    monkeypatch.setenv("PRSNET_PORT", "9001")
    monkeypatch.setenv("PRSNET_WORKERS", "3")
    result = runner.invoke(app, ["serve", "--port", "9002"])
    assert result.exit_code == 1
    assert (seen[0].port, seen[0].workers) == (9002, 3)


def test_warmup_runs_one_detection() -> None:
    result = runner.invoke(app, ["warmup"])
    assert result.exit_code == 0
    assert "1 planes and 2 axes" in result.stdout
