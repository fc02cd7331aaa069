"""Export: a trained run becomes weights that the service and the evaluation load."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from training.__main__ import app
from training.data.prepared import PreparedSet
from training.evaluation.evaluate import Options, evaluate
from training.evaluation.report import summarise
from training.recipe import Recipe
from training.trainer.fit import fit

RECIPE = Recipe.from_dict({
    "name": "short",
    "network": {"resolution": 16, "batch_norm": True},
    "input": {"frame": "inertia"},
    "loss": {"samples": 200},
    "optimizer": {"steps": 2, "batch": 8},
    "inference": {"passes": 2, "sign_frames": 8, "views": 3},
})  # fmt: skip


@pytest.fixture(scope="module")
def exported(prepared: PreparedSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("export")
    fit(RECIPE, prepared, root / "run", device="cpu")
    figures = root / "figures.json"
    figures.write_text('{"methods": {"x": 1}}')
    result = CliRunner().invoke(
        app,
        [
            "export",
            str(root / "run"),
            "-o",
            str(root / "mine.safetensors"),
            "--name",
            "mine",
            "--metrics",
            str(figures),
        ],
    )
    assert result.exit_code == 0, result.output
    return root / "mine.safetensors"


def test_export_keeps_the_whole_record(exported: Path, prepared: PreparedSet):
    record = json.loads(exported.with_suffix(".json").read_text())
    assert record["name"] == "mine"
    assert Recipe.from_dict(record["recipe"]) == RECIPE
    assert record["data"] == {"manifest_sha256": prepared.sha256, "shapes": 96, "skipped": 0}
    assert record["input"] == {"frame": "inertia", "passes": 2, "sign_frames": 8, "views": 3}
    assert record["metrics"]["figures"] == {"methods": {"x": 1}}
    assert record["metrics"]["training"]["step"] == 2


def test_export_of_a_folder_without_a_run_is_refused(tmp_path: Path):
    result = CliRunner().invoke(app, ["export", str(tmp_path), "-o", str(tmp_path / "x.safetensors")])
    assert result.exit_code == 2
    # In a box of lines, broken wherever the path ends.
    assert "no best checkpoint" in " ".join(result.output.replace("│", " ").split())


def test_exported_weights_are_judged_beside_the_shipped_ones(exported: Path, mesh_folder: Path):
    methods = (f"raw:{exported}", f"paper:{exported}", f"raw:{exported}+refined", "raw:untrained")
    records = evaluate([mesh_folder / "box"], Options("rotated", methods), limit=4, progress=False)
    report = summarise(records, 4e-4)
    assert report["clear"] == 4
    figures = report["methods"]
    assert figures[methods[0]]["planes"] == figures["raw:untrained"]["planes"] == 3.0
    # Two steps have hardly moved the planes from the axes of the inertia frame, which are those of a box.
    assert figures[methods[0]]["clear_best_mean"] < 1e-3 < figures["raw:untrained"]["clear_best_mean"]
    assert figures[methods[2]]["clear_best_mean"] < 1e-12
    assert figures[methods[2]]["plane_recall"] == 1.0
