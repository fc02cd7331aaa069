"""The command line, in process, with a detector whose answer is known."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from app import runtime, schemas, server
from app.cli import app
from app.settings import Settings
from model.errors import CheckpointError

from .fakes import DATA, FakeDetector

runner = CliRunner()


@pytest.fixture(autouse=True)
def served(monkeypatch: pytest.MonkeyPatch, detector: FakeDetector) -> FakeDetector:
    def load(weights: str) -> FakeDetector:
        if weights == "broken.safetensors":
            raise CheckpointError("The weights file is damaged.")
        return detector

    monkeypatch.setattr(runtime, "load_detector", load)
    return detector


def test_json_is_one_answer_a_line() -> None:
    result = runner.invoke(app, ["detect", "--json", str(DATA / "chair.obj"), str(DATA / "plant.off")])
    assert result.exit_code == 0
    answers = [schemas.DetectResponse.model_validate_json(line) for line in result.stdout.splitlines()]
    assert [answer.mesh.filename for answer in answers] == ["chair.obj", "plant.off"]
    assert set(json.loads(result.stdout.splitlines()[0])).isdisjoint({"bop", "rejected"})


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
    result = runner.invoke(app, ["detect", "--json", *files])
    assert result.exit_code == 1
    assert len(result.stdout.splitlines()) == 1
    assert "broken.obj: " in result.stderr
    assert "missing.obj: No such file" in result.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ["detect"],
        ["detect", "--mode", "quick", "a.obj"],
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
