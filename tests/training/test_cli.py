"""The command line, from procedural shapes to a curve, as a newcomer would type it."""

import json
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from training.__main__ import app

RECIPE = """
name = "tiny"
validation_share = 0.3
[network]
resolution = 8
[loss]
samples = 50
[optimizer]
steps = 2
batch = 4
"""


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_from_shapes_to_a_curve(tmp_path: Path):
    shapes, prepared, fitted = tmp_path / "shapes", tmp_path / "prepared", tmp_path / "run"
    result = run("shapes", "-o", shapes, "--count", 12, "--seed", 3)
    assert result.exit_code == 0, result.output
    assert len(list(shapes.glob("*.ply"))) == 12
    result = run("prepare", shapes, "-o", prepared, "--mesh-only", "--no-progress")
    assert result.exit_code == 0, result.output
    assert "12 shapes prepared, 0 skipped" in result.output
    recipe = tmp_path / "tiny.toml"
    recipe.write_text(RECIPE)
    result = run("fit", prepared, "--run", fitted, "--recipe", recipe, "--device", "cpu", "--no-tensorboard")
    assert result.exit_code == 0, result.output
    assert json.loads((fitted / "run.json").read_text())["recipe"]["name"] == "tiny"
    closing = shlex.split(result.output.strip().splitlines()[-1])
    assert closing[:3] == ["python", "-m", "training"]
    result = run(*closing[3:])  # what it says works as it stands
    assert result.exit_code == 0, result.output
    (fitted / "tiny.safetensors").rename(tmp_path / "tiny.safetensors")
    (fitted / "tiny.json").rename(tmp_path / "tiny.json")
    options = ("--recipe", recipe, "--device", "cpu", "--no-tensorboard", "--start", tmp_path / "tiny.safetensors")
    result = run("fit", prepared, "--run", tmp_path / "further", *options)
    assert result.exit_code == 0, result.output
    assert json.loads((tmp_path / "further/run.json").read_text())["start"]["name"] == "tiny"
    picture = tmp_path / "curve.png"
    result = run("curve", fitted, "-o", picture)
    assert result.exit_code == 0, result.output
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("prepare", "MISSING", "-o", "OUT"), "not a folder"),
        (("fit", "MISSING", "--run", "OUT"), "no prepared set"),
        (("fit", "MISSING", "--run", "OUT", "--recipe", "unheard-of"), "known ones are"),
        (("evaluate", "MISSING"), "not a folder"),
        (("evaluate", "MISSING", "--damage", "rust"), "one of clean"),
    ],
)
def test_mistakes_end_with_a_sentence_and_status_2(tmp_path: Path, arguments: tuple[str, ...], message: str):
    places = {"MISSING": str(tmp_path / "missing"), "OUT": str(tmp_path / "out")}
    result = run(*(places.get(argument, argument) for argument in arguments))
    assert result.exit_code == 2
    assert message in " ".join(result.output.replace("│", " ").split())


def test_help_keeps_its_brackets():
    assert "section [supervision]" in " ".join(run("label", "--help").output.split())
    assert "[default: scan]" in run("label", "--help").output


def test_every_command_explains_itself():
    for command in (
        "prepare",
        "label",
        "fit",
        "export",
        "evaluate",
        "reproduce",
        "groundtruth",
        "heldout",
        "shapes",
        "curve",
    ):
        result = run(command, "--help")
        assert result.exit_code == 0
        assert len(result.output.splitlines()) > 8
