"""Nothing is lost on the way out of the command line: names, files that are there, standard input."""

import csv
import io
import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
import trimesh
from typer.testing import CliRunner

from app import detection, local
from app.cli.commands import app
from app.cli.inputs import expand, unlike
from app.cli.tables import rounded_up
from model import Detector
from tests.app.fakes import DATA, FakeDetector

runner = CliRunner()
ONE = ["--jobs", "1"]


@pytest.fixture(autouse=True)
def served(monkeypatch: pytest.MonkeyPatch, detector: FakeDetector) -> Iterator[FakeDetector]:
    monkeypatch.setattr(detection, "load_detector", lambda weights: detector)
    local.detector_of.cache_clear()
    yield detector
    local.detector_of.cache_clear()


@pytest.fixture
def twice(tmp_path: Path) -> Path:
    """Two models of one name in different folders, as ShapeNet has them, and a third of the same in another format."""
    for folder, name in (("a/models", "plant.off"), ("b/models", "chair.obj")):
        (tmp_path / "in" / folder).mkdir(parents=True)
        shutil.copy(DATA / name, tmp_path / "in" / folder / f"model.{name[-3:]}")
    shutil.copy(DATA / "vase.ply", tmp_path / "in" / "b" / "models" / "model.ply")
    shutil.copy(DATA / "barrel.stl", tmp_path / "in" / "other.stl")
    return tmp_path / "in"


NAMES = ["a/models/model", "b/models/model.obj", "b/models/model.ply", "other"]


def test_equal_names_keep_their_folders_and_extensions(twice: Path, tmp_path: Path) -> None:
    result = runner.invoke(app, ["detect", str(twice), "--bop", *ONE])
    assert result.exit_code == 0, result.stderr
    assert sorted(json.loads(result.stdout)) == NAMES
    out = tmp_path / "out"
    result = runner.invoke(app, ["detect", str(twice), "--csv", "--glb", "--png", "-o", str(out), *ONE])
    assert result.exit_code == 0, result.stderr
    written = sorted(path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file())
    assert written == sorted(f"{name}-symmetries.{kind}" for name in NAMES for kind in ("glb", "png"))
    files = {row["file"] for row in csv.DictReader(io.StringIO(result.stdout))}
    assert files == {str(path) for path in expand([str(twice)])[0]}


def test_names_of_bop_models_are_their_numbers_until_they_collide() -> None:
    from app.outputs import bop

    paths = [Path("lm/models/obj_000001.ply"), Path("lm/models/obj_000002.ply")]
    assert list(unlike(paths, bop.model_id).values()) == ["1", "2"]
    paths.append(Path("tless/models/obj_000002.ply"))
    assert list(unlike(paths, bop.model_id).values()) == ["1", "lm/models/2", "tless/models/2"]


def test_nothing_is_overwritten_unasked(tmp_path: Path) -> None:
    chair = str(DATA / "chair.obj")
    for command, place in (
        (["detect", chair, "--glb", "-o", str(tmp_path)], tmp_path / "chair-symmetries.glb"),
        (["detect", chair, "--csv", "-o", str(tmp_path / "a.csv")], tmp_path / "a.csv"),
        (["complete", chair, "-o", str(tmp_path / "c.ply")], tmp_path / "c.ply"),
        (["halve", chair, "-o", str(tmp_path / "h.ply")], tmp_path / "h.ply"),
        (["align", chair, "-o", str(tmp_path / "l.ply")], tmp_path / "l.ply"),
        (["sector", chair, "-o", str(tmp_path / "s.ply"), "--axis", "0,1,0", "--order", "4"], tmp_path / "s.ply"),
    ):
        place.write_text("precious")
        result = runner.invoke(app, command)
        assert result.exit_code == 2
        assert "--overwrite" in result.stderr
        assert place.read_text() == "precious"
        assert runner.invoke(app, [*command, "--overwrite"]).exit_code == 0
        assert place.read_bytes() != b"precious"


def test_own_output_is_not_read_back_in(tmp_path: Path) -> None:
    shutil.copy(DATA / "chair.obj", tmp_path)
    shutil.copy(DATA / "table.glb", tmp_path / "my-symmetries.glb")  # somebody's, named like ours
    command = ["detect", str(tmp_path), "--glb", "--jsonl", "-o", str(tmp_path), *ONE]
    assert len(runner.invoke(app, command).stdout.splitlines()) == 2
    again = runner.invoke(app, [*command, "--overwrite"])
    assert len(again.stdout.splitlines()) == 2
    assert [path.name for path in expand([f"{tmp_path}/*"])[0]] == ["chair.obj", "my-symmetries.glb"]
    assert [path.name for path in expand([f"{tmp_path}/chair-symmetries.glb"])[0]] == ["chair-symmetries.glb"]


@pytest.mark.parametrize(
    ("option", "name"), [("--csv", "a.txt"), (None, "a.csv"), ("--bop", "a.json"), (None, "b.jsonl")]
)
def test_a_result_goes_to_the_file_that_is_named(option: str | None, name: str, tmp_path: Path) -> None:
    chosen = [option] if option else []
    result = runner.invoke(app, ["detect", str(DATA / "chair.obj"), *chosen, "-o", str(tmp_path / "new" / name)])
    assert (result.exit_code, result.stdout) == (0, "")
    printed = runner.invoke(app, ["detect", str(DATA / "chair.obj"), option or f"--{name[2:]}"]).stdout
    text = (tmp_path / "new" / name).read_bytes().decode()

    def plain(text: str) -> str:
        return text.split('"timings_ms"')[0].replace("\r\n", "\n")

    assert plain(text) == plain(printed)
    assert text


@pytest.mark.parametrize("name", ["table.dat", ""])
def test_a_file_for_no_format_is_wrong_usage(name: str, tmp_path: Path) -> None:
    assert runner.invoke(app, ["detect", str(DATA / "chair.obj"), "-o", str(tmp_path / name)]).exit_code == 2


@pytest.mark.parametrize(
    "name", ["chair.obj", "barrel.stl", "table.glb", "vase.ply", "plant.off", "stool.3mf", "donut.gltf"]
)
def test_a_dash_reads_standard_input(name: str, tmp_path: Path) -> None:
    data = (DATA / name).read_bytes()
    result = runner.invoke(app, ["detect", "-", "--json", "--glb", "-o", str(tmp_path)], input=data)
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout)["mesh"]["filename"] == f"stdin.{name[-4:].lstrip('.')}"
    assert (tmp_path / "stdin-symmetries.glb").exists()


def test_a_dash_for_the_other_commands(tmp_path: Path) -> None:
    data = (DATA / "chair.obj").read_bytes()
    for command in ("halve", "complete", "align"):
        result = runner.invoke(app, [command, "-", "-o", str(tmp_path / f"{command}.ply")], input=data)
        assert result.exit_code == 0, result.stderr
    assert runner.invoke(app, ["detect", "-"], input=b"nothing known").exit_code == 2


def test_twins(tmp_path: Path) -> None:
    chair = trimesh.load(DATA / "plant.off", force="mesh")
    chair.apply_transform(trimesh.transformations.rotation_matrix(1.0, [1, 2, 3], [4, 5, 6]))
    chair.export(tmp_path / "moved.ply")
    chair.vertices[:, 2] *= -1
    chair.export(tmp_path / "mirrored.ply")
    one = str(DATA / "plant.off")
    same = runner.invoke(app, ["twins", one, str(tmp_path / "moved.ply")])
    assert same.exit_code == 0
    assert "congruent: the same part" in same.stdout
    mirrored = runner.invoke(app, ["twins", one, str(tmp_path / "mirrored.ply"), "--json"])
    assert json.loads(mirrored.stdout)["relation"] == "mirror_images"
    assert runner.invoke(app, ["twins", one, str(DATA / "chair.obj")]).exit_code == 1
    missing = runner.invoke(app, ["twins", one, str(tmp_path / "none.ply")])
    assert (missing.exit_code, "No such file" in missing.stderr) == (1, True)


def test_what_was_left_out_is_told_by_every_command(tmp_path: Path) -> None:
    text = (DATA / "chair.obj").read_text() + "f 1 2 99999\n"
    (tmp_path / "broken.obj").write_text(text)
    for command in ("halve", "complete", "align"):
        result = runner.invoke(app, [command, str(tmp_path / "broken.obj"), "-o", str(tmp_path / f"{command}.ply")])
        assert result.exit_code == 0, result.stderr
        assert "warning: 1 face was left out" in result.stderr


def test_without_a_symmetry_the_best_candidate_is_told() -> None:
    local.detector_of.cache_clear()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(detection, "load_detector", Detector.load)
        result = runner.invoke(app, ["detect", str(DATA / "plant.off")])
    words = re.search(
        r"the (plane|axis) \(.*error of ([\d.e-]+), which needs at least --max-error ([\d.e-]+)",
        " ".join(result.stdout.split()),
    )
    assert words, result.stdout
    assert 4e-4 < float(words[2]) <= float(words[3]) <= 1.1 * float(words[2])


@pytest.mark.parametrize("error", [4.0e-4, 9.99e-3, 1.0, 1.23456e-7])
def test_a_threshold_is_rounded_upwards(error: float) -> None:
    assert error <= rounded_up(error) <= 1.11 * error


def test_symmetry_axes_for_foundationpose(tmp_path: Path) -> None:
    result = runner.invoke(app, ["detect", str(DATA / "chair.obj"), "--format", "foundationpose"])
    assert result.exit_code == 0, result.stderr
    answer = json.loads(runner.invoke(app, ["detect", str(DATA / "chair.obj"), "--json"]).stdout)
    entry = json.loads(result.stdout)["chair"]
    told = {name[0] for name in entry["symmetry_axes"]}
    along = ["xyz"[axis["direction"].index(1.0)] for axis in answer["axes"] if 1.0 in axis["direction"]]
    assert told == set(along)
    assert entry["left_out"] == len(answer["axes"]) - len(along)
    for axis in answer["axes"]:
        if axis["order"] and 1.0 in axis["direction"]:
            name = "xyz"[axis["direction"].index(1.0)]
            assert f"{name}_{360 / axis['order']:g}" in entry["symmetry_axes"]
