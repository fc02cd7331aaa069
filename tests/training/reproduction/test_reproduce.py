"""Experiments: shipped ones fit the code, results come out whole, an interrupted one goes on, networks are trained."""

import csv
import shutil
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import training.evaluation.evaluate as evaluation
from training.__main__ import app
from training.data.prepared import PreparedSet
from training.evaluation import registry, shrec
from training.evaluation.corruptions import DAMAGES
from training.evaluation.registry import expand
from training.recipe import Recipe
from training.reproduction import networks, run
from training.reproduction.experiment import Experiment, known_experiments
from training.reproduction.networks import judged_on, recipe_of
from training.reproduction.pictures import GALLERIES
from training.reproduction.run import COLUMNS, PICTURES, reproduce
from training.shapes.catalogue import write_shapes
from training.shapes.clouds import PERTURBATIONS
from training.trainer.fit import fit
from training.trainer.monitor import CollapseError

HEAD = """
title = "A table"
claim = "The paper says so."
differences = "None."
minimum = "Nothing."
"""
COMPARE = (
    HEAD
    + """
methods = ["pca", "pca+refined"]
columns = ["shapes", "clear_best_mean", "gte_mean", "completion"]
damages = ["rotated", "partial"]
symmetric = true
limit = 4
gallery = 2
pictures = ["best", "planes", "axes", "completed"]
sheet = true
"""
)
TRAIN = (
    HEAD
    + """
methods = ["pca"]
columns = ["shapes", "best_mean"]
chart = "best_mean"
limit = 3
steps = 2
train_share = 0.6
[[variants]]
name = "tiny"
label = "pca"
settings = [
  "network.resolution=8", "network.channels=[]", "network.width=1", "loss.samples=50", "optimizer.batch=4",
  "validation_share=0.3",
]
methods = ["raw:WEIGHTS"]
"""
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("reproduction") / "meshes"
    write_shapes(root, 24, seed=3, only=("box", "mirror", "none"))
    return root


@pytest.mark.parametrize("name", known_experiments())
def test_shipped_experiments_name_what_there_is(name: str):
    experiment = Experiment.load(name)
    assert {*experiment.columns, experiment.chart} <= set(COLUMNS[experiment.protocol])
    assert set(experiment.damages) <= set(PERTURBATIONS if experiment.protocol == "shrec" else DAMAGES)
    expand(experiment.methods)
    assert experiment.methods or experiment.variants
    assert set(experiment.pictures) <= set(GALLERIES) == set(PICTURES)
    for variant in experiment.variants:
        Recipe.load(experiment.recipe).with_settings(variant.settings)
        expand([method.replace("WEIGHTS", "x.safetensors") for method in variant.methods])


def test_results_come_out_and_a_second_call_judges_nothing_anew(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    recipe, out = tmp_path / "compare.toml", tmp_path / "out"
    recipe.write_text(COMPARE)
    text = reproduce(str(recipe), [folder], out, progress=False)
    assert text.count("| PCA + refinement | 4 |") == 2
    assert "The paper says so." in text
    rows = list(csv.DictReader((out / "results.csv").read_text().splitlines()))
    assert [(row["damage"], row["method"]) for row in rows] == [
        ("rotated", "pca"),
        ("rotated", "pca+refined"),
        ("partial", "pca"),
        ("partial", "pca+refined"),
    ]
    by = {(row["damage"], row["method"]): float(row["clear_best_mean"]) for row in rows}
    assert by["rotated", "pca+refined"] < 1e-12
    assert float(rows[0]["apart"]) == pytest.approx(90.0)  # of eigenvectors
    assert by["rotated", "pca+refined"] < by["partial", "pca"]
    for picture in (
        "chart.png",
        "gallery-rotated.png",
        "gallery-partial.png",
        "planes-rotated.png",
        "axes-rotated.png",
    ):
        assert (out / picture).read_bytes().startswith(b"\x89PNG")
    monkeypatch.setattr(evaluation, "_judge_file", None)  # would fail if it were called
    assert reproduce(str(recipe), [folder], out, progress=False) == text


def test_networks_are_trained_on_shapes_that_none_is_judged_on(folder: Path, tmp_path: Path):
    recipe, out = tmp_path / "train.toml", tmp_path / "out"
    recipe.write_text(TRAIN)
    text = reproduce(str(recipe), [folder], out, progress=False)
    assert "| tiny: raw | 3 |" in text
    prepared = PreparedSet(out / "prepared")
    trained = {shape.name for shape in prepared.shapes}
    assert 0 < len(trained) < 24
    assert not any(judged_on(name, 0.6) for name in trained)
    assert (out / "curves.png").is_file()
    weights = (out / "tiny.safetensors").read_bytes()
    assert reproduce(str(recipe), [folder], out, progress=False) == text
    assert (out / "tiny.safetensors").read_bytes() == weights


def test_networks_are_judged_on_the_folder_that_is_named_and_experiments_share_a_set(folder: Path, tmp_path: Path):
    recipe, judged, shared = tmp_path / "train.toml", tmp_path / "judged", tmp_path / "set"
    recipe.write_text(TRAIN)
    write_shapes(judged, 3, seed=4, only=("box",))
    for out in (tmp_path / "a", tmp_path / "b"):
        text = reproduce(str(recipe), [folder], out, judged=[judged], prepared=shared, progress=False)
        assert "| tiny: raw | 3 |" in text
        assert "Shapes: judged" in text
    assert len(PreparedSet(shared).shapes) == 24  # all of the folder
    assert not (tmp_path / "b" / "prepared").exists()


def test_other_weights_of_the_same_name_are_judged_anew(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    recipe, out = tmp_path / "train.toml", tmp_path / "out"
    recipe.write_text(TRAIN)
    reproduce(str(recipe), [folder], out, progress=False)
    shutil.rmtree(out / "runs")
    asked: list[tuple[str, ...]] = []
    original = evaluation._judge_file

    def counted(job: evaluation._Job) -> dict[str, object]:
        asked.append(job.methods)
        return original(job)

    monkeypatch.setattr(evaluation, "_judge_file", counted)
    reproduce(str(recipe), [folder], out, settings=["seed=5"], progress=False)
    assert asked == [(f"raw:{out / 'tiny.safetensors'}",)] * 3  # and PCA is what it was


def test_a_network_that_collapses_is_judged_at_its_best(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def collapsing(*arguments: Any, **options: Any) -> Path:
        fit(*arguments, **options)
        raise CollapseError("it says the same of every shape")

    monkeypatch.setattr(networks, "fit", collapsing)
    recipe, said = tmp_path / "train.toml", list[str]()
    recipe.write_text(TRAIN)
    text = reproduce(str(recipe), [folder], tmp_path / "out", progress=False, tell=said.append)
    assert "| tiny: raw | 3 |" in text
    assert any("ended early" in line and "the same of every shape" in line for line in said)


def test_a_shorter_run_is_pre_trained_for_the_same_share_of_it():
    experiment = Experiment.load("pretraining")
    variant = experiment.variants[0]
    whole, short = recipe_of(experiment, variant), recipe_of(experiment, variant, steps=1200)
    assert whole.supervision.until_step * short.optimizer.steps == short.supervision.until_step * whole.optimizer.steps
    assert recipe_of(experiment, variant, 1200, ["supervision.until_step=7"]).supervision.until_step == 7


def test_options_of_training_are_refused_where_nothing_is_trained(folder: Path, tmp_path: Path):
    recipe = tmp_path / "compare.toml"
    recipe.write_text(COMPARE)
    with pytest.raises(ValueError, match="trains nothing"):
        reproduce(str(recipe), [folder], tmp_path / "out", steps=3, progress=False)


def test_some_networks_of_an_experiment_are_trained_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    asked: list[list[str]] = []

    def trained(experiment: Experiment, *arguments: Any, **options: Any) -> dict[str, Any]:
        asked.append([variant.name for variant in experiment.variants])
        raise ValueError("that is all")

    monkeypatch.setattr(run, "train_networks", trained)
    with pytest.raises(ValueError, match="that is all"):
        reproduce("table4", [tmp_path], tmp_path / "out", variants=["32-voxels", "16-voxels"], progress=False)
    assert asked == [["32-voxels", "16-voxels"]]
    with pytest.raises(ValueError, match="trains no 8-voxels; its networks are 16-voxels"):
        reproduce("table4", [tmp_path], tmp_path / "out", variants=["8-voxels"], progress=False)


def test_other_methods_are_added_to_what_is_there(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    recipe, out = tmp_path / "compare.toml", tmp_path / "out"
    recipe.write_text(COMPARE.replace("gallery = 2", "").replace("sheet = true", ""))
    whole = reproduce(str(recipe), [folder], out, progress=False)
    added = reproduce(str(recipe), [folder], out, methods=["pca", "bounding_box"], progress=False)
    assert "| oriented bounding box | 4 |" in added
    assert "refinement" not in added
    monkeypatch.setattr(evaluation, "_judge_file", None)  # would fail if it were called
    assert reproduce(str(recipe), [folder], out, progress=False) == whole


def test_a_table_says_of_which_revision_it_is_and_methods_are_renewed(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    recipe, out = tmp_path / "compare.toml", tmp_path / "out"
    recipe.write_text(
        COMPARE.replace('["rotated", "partial"]', '["rotated"]').replace("gallery = 2", "").replace("sheet = true", "")
    )
    monkeypatch.setattr(registry, "git_revision", lambda: "a" * 40)
    assert "Judged at revision aaaaaaa." in reproduce(str(recipe), [folder], out, progress=False)
    monkeypatch.setattr(registry, "git_revision", lambda: "b" * 40 + "-dirty")
    assert "Judged at revision aaaaaaa." in reproduce(str(recipe), [folder], out, progress=False)
    text = reproduce(str(recipe), [folder], out, renew=["pca"], progress=False)
    assert "Judged at revision bbbbbbb-dirty: PCA; aaaaaaa: PCA + refinement." in text
    with pytest.raises(ValueError, match="no method full is asked for"):
        reproduce(str(recipe), [folder], out, renew=["full"], progress=False)


def test_without_meshes_procedural_ones_are_made(tmp_path: Path):
    recipe = tmp_path / "compare.toml"
    recipe.write_text(
        COMPARE.replace('["rotated", "partial"]', '["clean"]').replace("gallery = 2", "").replace("sheet = true", "")
    )
    text = reproduce(str(recipe), [], tmp_path / "out", limit=2, progress=False)
    assert "clean: 2 shapes, 2 of them with a clear plane" in text


def test_clouds_are_made_and_a_second_call_judges_none_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    recipe, out = tmp_path / "clouds.toml", tmp_path / "out"
    recipe.write_text(f'{HEAD}methods = ["pca"]\nprotocol = "shrec"\ndamages = ["clean", "hard"]\nchart = "map"\n')
    text = reproduce(str(recipe), [], out, limit=2, progress=False)
    assert text.count("| PCA | 2 |") == 2
    assert (out / "chart.png").read_bytes().startswith(b"\x89PNG")
    monkeypatch.setattr(shrec, "_judge", None)  # would fail if it were called
    assert reproduce(str(recipe), [], out, limit=2, progress=False) == text


def test_the_command_lists_experiments_and_says_what_is_wrong(tmp_path: Path):
    listed = CliRunner().invoke(app, ["reproduce", "list"])
    assert listed.exit_code == 0
    assert "Table 1" in listed.output
    wrong = CliRunner().invoke(app, ["reproduce", "table99"])
    assert wrong.exit_code == 2
    assert "there is no experiment" in wrong.output
    recipe = tmp_path / "misspelt.toml"
    recipe.write_text(COMPARE + "colour = 3\n")
    assert "has no field colour" in CliRunner().invoke(app, ["reproduce", str(recipe)]).output
