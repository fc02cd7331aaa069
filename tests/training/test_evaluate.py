"""Export and evaluation: the figures are the geometry's, and a trained run becomes weights the service loads."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from model.frames import UnitFrame
from model.mesh import as_mesh as read
from model.surface import SurfaceIndex
from model.transforms import reflect
from tests.shapes import box
from training.__main__ import app
from training.baselines import pca_planes
from training.evaluate import PCA, UNTRAINED, evaluate, render
from training.fit import fit
from training.prepared import PreparedSet
from training.recipe import Recipe
from training.shapes import write_shapes

RECIPE = Recipe.from_dict({
    "name": "short",
    "network": {"resolution": 16, "batch_norm": True},
    "input": {"frame": "inertia"},
    "loss": {"samples": 200},
    "optimizer": {"steps": 2, "batch": 8},
    "inference": {"passes": 2, "sign_frames": 8},
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
    assert record["input"] == {"frame": "inertia", "passes": 2, "sign_frames": 8}
    assert record["metrics"]["figures"] == {"methods": {"x": 1}}
    assert record["metrics"]["training"]["step"] == 2


def test_export_of_a_folder_without_a_run_is_refused(tmp_path: Path):
    result = CliRunner().invoke(app, ["export", str(tmp_path), "-o", str(tmp_path / "x.safetensors")])
    assert result.exit_code == 2
    assert "no best checkpoint" in result.output


@pytest.mark.parametrize("damage", ["clean", "partial"])
def test_evaluation_of_boxes_and_chairs(exported: Path, mesh_folder: Path, tmp_path: Path, damage: str):
    folders = [mesh_folder / "box", mesh_folder / "none"]
    cache = tmp_path / "reference.json"
    report = evaluate(folders, [str(exported)], limit=8, damage=damage, reference=cache, progress=False)
    assert report["shapes"] == 8
    boxes = sum("box" in name for name in json.loads(cache.read_text()))
    assert report["clear"] == boxes  # boxes have clear planes, irregular solids none
    assert set(report["methods"]) == {str(exported), PCA, UNTRAINED}
    pca = report["methods"][PCA]
    if damage == "clean":
        assert pca["clear_share_under_threshold"] == 1.0
        assert pca["gte_mean"] < 1e-12
        assert pca["recall_1_degree"] == 1.0
    else:
        assert pca["gte_mean"] > 1e-6  # what a hole does to the principal axes
    # Nothing a client receives exceeds the threshold by more than sampling explains.
    assert all(math.isfinite(value) for figures in report["methods"].values() for value in figures.values())
    assert "| PCA |" in render(report)
    again = evaluate(folders, [str(exported)], limit=8, damage=damage, reference=cache, progress=False)
    assert again == report


def test_pca_is_exact_on_a_box():
    mesh = box(1, 2, 4)
    vertices = UnitFrame.of(mesh.vertices, mesh.faces).to_unit(mesh.vertices)
    surface = SurfaceIndex(vertices, mesh.faces)
    for plane in pca_planes(vertices, mesh.faces):
        assert surface.mean_squared_distance(reflect(vertices, plane)) < 1e-20


def test_ground_truth_beside_the_meshes_is_used(exported: Path, tmp_path: Path):
    """The written planes, moved to the unit frame, are exact symmetries; wrong ones would be believed too."""
    write_shapes(tmp_path / "shapes", 3, seed=1, only=("pyramid", "box", "mirror"))
    cache = tmp_path / "cache.json"
    evaluate([tmp_path / "shapes"], [str(exported)], reference=cache, progress=False)
    for name, planes in json.loads(cache.read_text()).items():
        mesh = read(tmp_path / name)
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
        vertices = frame.to_unit(mesh.vertices)
        surface = SurfaceIndex(vertices, mesh.faces)
        assert planes
        assert max(surface.mean_squared_distance(reflect(vertices, np.array(plane))) for plane in planes) < 1e-20
    truth = tmp_path / "shapes" / "ground_truth.json"
    entries = json.loads(truth.read_text())
    for entry in entries.values():
        entry["planes"] = [[0.6, 0.0, 0.8, 0.0]]
    truth.write_text(json.dumps(entries))
    wrong = evaluate([tmp_path / "shapes"], [str(exported)], progress=False)
    assert wrong["methods"][PCA]["angle_median"] > 1.0
