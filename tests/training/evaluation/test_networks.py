"""Export and evaluation: the figures are the geometry's, and a trained run becomes weights the service loads."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from model.geometry.frames import UnitFrame
from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect
from tests.shapes import box
from training.__main__ import app
from training.baselines.classical import box_planes, pca_planes
from training.data.prepared import PreparedSet
from training.evaluation.network_report import render, summarise
from training.evaluation.networks import BOX, PCA, UNTRAINED, Options, evaluate
from training.recipe import Recipe
from training.shapes.catalogue import write_shapes
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


@pytest.mark.parametrize("damage", ["rotated", "partial", "noisy"])
def test_evaluation_of_boxes_and_irregular_solids(exported: Path, mesh_folder: Path, damage: str):
    folders = [mesh_folder / "box", mesh_folder / "none"]
    records = evaluate(folders, Options((str(exported),), damage), limit=8, progress=False)
    report = summarise(records)
    assert report["shapes"] == 8
    assert report["clear"] == sum("box" in record["name"] for record in records)  # irregular solids have no clear plane
    assert set(report["methods"]) == {PCA, BOX, str(exported), UNTRAINED}
    for rival in (PCA, BOX):
        figures = report["methods"][rival]
        if damage == "rotated":
            assert figures["clear_share"] == figures["recall_1"] == 1.0
            assert figures["gte_mean"] < 1e-12
        elif rival == PCA:
            assert figures["gte_mean"] > 1e-6  # what a hole or noise does to the principal axes
    assert all(math.isfinite(value) for figures in report["methods"].values() for value in figures.values())
    assert "| PCA |" in render(report, damage)
    again = evaluate(folders, Options((str(exported),), damage), limit=8, progress=False)
    assert [record["methods"][PCA] for record in again] == [record["methods"][PCA] for record in records]


def test_tables_by_source_and_figures_as_json(exported: Path, mesh_folder: Path, tmp_path: Path):
    out = tmp_path / "figures.json"
    arguments = ["evaluate", str(mesh_folder), "--weights", str(exported), "--limit", "6", "--by", "source"]
    result = CliRunner().invoke(app, [*arguments, "--json", str(out), "--no-progress"])
    assert result.exit_code == 0, result.output
    assert "## By source" in result.stdout
    document = json.loads(out.read_text())
    assert document["shapes"] == 6
    assert document["options"]["damage"] == "rotated"
    missing = CliRunner().invoke(app, [*arguments[:-1], "kind"])
    assert missing.exit_code == 2
    assert "--manifest" in missing.output


def test_pca_is_exact_on_a_box():
    mesh = box(1, 2, 4)
    vertices = UnitFrame.of(mesh.vertices, mesh.faces).to_unit(mesh.vertices)
    surface = SurfaceIndex(vertices, mesh.faces)
    for plane in pca_planes(vertices, mesh.faces):
        assert surface.mean_squared_distance(reflect(vertices, plane)) < 1e-20


def test_the_box_follows_a_flat_shape_too():
    """A rectangle has no hull; its three mid-planes are symmetries all the same."""
    vertices = np.array([[-0.4, -0.3, 0.0], [0.4, -0.3, 0.0], [0.4, 0.3, 0.0], [-0.4, 0.3, 0.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
    surface = SurfaceIndex(vertices, faces)
    for plane in box_planes(vertices, faces):
        assert surface.mean_squared_distance(reflect(vertices, plane)) < 1e-20


def test_ground_truth_beside_the_meshes_is_used(exported: Path, tmp_path: Path):
    """PCA meets the written planes of a box; wrong ones would be believed too."""
    write_shapes(tmp_path / "shapes", 2, seed=1, only=("box",))

    def angle() -> float:
        records = evaluate([tmp_path / "shapes"], Options((str(exported),)), progress=False)
        return summarise(records)["methods"][PCA]["angle_median"]

    assert angle() < 1e-3
    truth = tmp_path / "shapes" / "ground_truth.json"
    entries = json.loads(truth.read_text())
    for entry in entries.values():
        entry["planes"], entry["axes"] = [[0.6, 0.0, 0.8, 0.0]], []
    truth.write_text(json.dumps(entries))
    assert angle() > 1.0
