"""Training learns, resumes exactly, and refuses what does not belong together."""

import csv
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from model.network.checkpoint import load_checkpoint
from model.network.network import PRSNet
from training.data.prepare import Options, prepare
from training.data.prepared import PreparedSet
from training.data.store import ShapeStore
from training.recipe import OptimizerRecipe, Recipe
from training.trainer.export import export_run
from training.trainer.fit import Initialization, fit, learning_rate
from training.trainer.objective import validate

FACTOR = 2.0
"""A minute of training must cut the held-out error of the planes by this factor."""

TINY = Recipe.from_dict({
    "name": "tiny",
    "validation_share": 0.2,
    "network": {"resolution": 16, "batch_norm": True},
    "input": {"frame": "inertia", "jitters": [0.35], "jitter_shares": [1.0]},
    "loss": {"samples": 200, "regularization": 2.0},
    "optimizer": {"steps": 12, "batch": 8, "learning_rate": 0.005, "schedule": "one-cycle"},
})  # fmt: skip


def weights(path: Path) -> dict[str, torch.Tensor]:
    return torch.load(path, weights_only=True)["network"]


def curve(run: Path) -> list[dict[str, str]]:
    with (run / "curve.csv").open(newline="") as lines:
        return list(csv.DictReader(lines))


def test_a_minute_of_training_beats_the_initial_planes(prepared: PreparedSet, tmp_path: Path):
    """The input is the inertia frame turned by about 0.35 rad a component: the network learns to turn planes back."""
    recipe = TINY.replace(
        network={"resolution": 32}, optimizer={"steps": 350, "batch": 16}, loss={"samples": 400, "regularization": 5.0}
    )
    store = ShapeStore(prepared, torch.device("cpu"), recipe.loss.grid)
    held_out = torch.from_numpy(prepared.split(recipe.validation_share)[1])
    torch.manual_seed(recipe.seed)
    before = validate(PRSNet(recipe.network), store, held_out, recipe)
    run = fit(recipe, prepared, tmp_path, device="cpu", validate_every=350).parent
    network = PRSNet(recipe.network)
    network.load_state_dict(weights(run / "best.pt"))
    after = validate(network, store, held_out, recipe)
    assert after["validation_best_plane"] < before["validation_best_plane"] / FACTOR
    assert after["validation_loss"] < before["validation_loss"]
    row = curve(run)[-1]
    # The heads have left their initial values and follow the input; the rotations have not collapsed.
    assert float(row["normal_std"]) > 0.1
    assert float(row["rotation_sine"]) > 0.7


def test_an_interrupted_run_ends_bit_for_bit_the_same(prepared: PreparedSet, tmp_path: Path):
    fit(TINY, prepared, tmp_path / "whole", device="cpu", log_every=2, validate_every=6)
    # Stops after its first step, as if killed, then goes on.
    fit(TINY, prepared, tmp_path / "cut", device="cpu", log_every=2, validate_every=6, max_seconds=0.0)
    assert int(curve(tmp_path / "cut")[-1]["step"]) == 1
    fit(TINY, prepared, tmp_path / "cut", device="cpu", log_every=2, validate_every=6)
    whole, cut = weights(tmp_path / "whole" / "last.pt"), weights(tmp_path / "cut" / "last.pt")
    assert whole.keys() == cut.keys()
    for key, value in whole.items():
        assert torch.equal(value, cut[key]), key
    columns = ("step", "loss", "validation_loss")
    tail = [[row[key] for key in columns] for row in curve(tmp_path / "whole")]
    assert [[row[key] for key in columns] for row in curve(tmp_path / "cut")][1:] == tail


def test_lines_behind_the_last_checkpoint_are_written_once(prepared: PreparedSet, tmp_path: Path):
    fit(TINY, prepared, tmp_path, device="cpu", log_every=2, validate_every=6, max_seconds=0.0)
    with (tmp_path / "curve.csv").open("a") as lines:
        lines.write("4,1,1,1,1,1,1,1,1,1,,,,\n")
    fit(TINY, prepared, tmp_path, device="cpu", log_every=2, validate_every=6)
    steps = [int(row["step"]) for row in curve(tmp_path)]
    assert steps == sorted(set(steps))


def test_seeds_matter_and_repeat(prepared: PreparedSet, tmp_path: Path):
    short = TINY.replace(optimizer={"steps": 3})
    for name, recipe in (("a", short), ("b", short), ("c", short.replace(seed=5))):
        fit(recipe, prepared, tmp_path / name, device="cpu")
    a, b, c = (weights(tmp_path / name / "last.pt")["features.0.weight"] for name in "abc")
    assert torch.equal(a, b)
    assert not torch.equal(a, c)


def test_a_run_folder_belongs_to_one_recipe_and_one_set(prepared: PreparedSet, tmp_path: Path):
    short = TINY.replace(optimizer={"steps": 1})
    fit(short, prepared, tmp_path, device="cpu")
    with pytest.raises(ValueError, match="another recipe or other data"):
        fit(short.replace(seed=9), prepared, tmp_path, device="cpu")
    # A run begun before a section of the recipe existed goes on: the section has its defaults.
    stamp = tmp_path / "run.json"
    record = json.loads(stamp.read_text())
    del record["recipe"]["sampling"]
    stamp.write_text(json.dumps(record))
    fit(short, prepared, tmp_path, device="cpu")


def test_grids_are_derived_where_the_set_has_none(mesh_folder: Path, tmp_path: Path):
    prepare([mesh_folder / "box"], tmp_path / "set", Options(mesh_only=True), progress=False)
    bare = PreparedSet(tmp_path / "set")
    seen: list[tuple[int, int]] = []
    short = TINY.replace(optimizer={"steps": 2}, loss={"grid": 16})
    fit(short, bare, tmp_path / "run", device="cpu", on_derive=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (16, 16)
    assert math.isfinite(float(curve(tmp_path / "run")[-1]["loss"]))


def test_the_one_cycle_rate_rises_then_falls_to_zero():
    recipe = OptimizerRecipe(steps=1000, learning_rate=0.01, schedule="one-cycle", warmup=0.1)
    rates = np.array([learning_rate(recipe, step) for step in range(1001)])
    assert rates.argmax() == 100
    assert rates.max() == pytest.approx(0.01)
    assert (np.diff(rates[:101]) > 0).all()
    assert (np.diff(rates[100:]) < 0).all()
    assert rates[-1] == pytest.approx(0.0, abs=1e-12)
    constant = OptimizerRecipe(learning_rate=0.01)
    assert learning_rate(constant, 0) == learning_rate(constant, 10**6) == 0.01


def test_fit_needs_torch_and_numpy_alone():
    """A fresh interpreter in which every other library is forbidden imports the trainer."""
    code = """
import importlib.abc, sys
class Forbid(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {"trimesh", "numba", "scipy", "fastapi", "pydantic", "safetensors", "tqdm"}:
            raise ImportError(name)
sys.meta_path.insert(0, Forbid())
import torch, training.trainer.fit
from training.inputs.inputs import voxels_of
from training.inputs.meshbatch import MeshBatch
triangle = torch.tensor([[[-0.4, 0.0, 0.0], [0.4, 0.0, 0.0], [0.0, 0.4, 0.0]]])
voxels = voxels_of(MeshBatch(triangle, torch.zeros(1, dtype=torch.long), 1), 16)
assert voxels.sum() > 40, voxels.sum()
"""
    root = Path(__file__).parents[3]
    subprocess.run([sys.executable, "-c", code], cwd=root, check=True, timeout=120)


def test_a_run_begins_with_given_weights(prepared: PreparedSet, tmp_path: Path):
    first = fit(TINY, prepared, tmp_path / "first", device="cpu").parent
    export_run(first, tmp_path / "first.safetensors", which="last")
    first_weights = load_checkpoint(tmp_path / "first.safetensors")
    start = Initialization(
        first_weights.network, {"name": "first", "version": "1", "sha256": first_weights.metadata["sha256"]}
    )
    still = TINY.replace(optimizer={"steps": 1, "learning_rate": 0.0})
    second = fit(still, prepared, tmp_path / "second", start=start, device="cpu").parent
    for name, tensor in weights(first / "last.pt").items():
        # Normalisation counts what it has seen; nothing else moves at a rate of zero.
        if "running" not in name and "tracked" not in name:
            assert torch.equal(tensor, weights(second / "last.pt")[name]), name
    export_run(second, tmp_path / "second.safetensors")
    record = load_checkpoint(tmp_path / "second.safetensors").metadata
    assert record["start"] == start.record


def test_another_start_or_architecture_is_refused(prepared: PreparedSet, tmp_path: Path):
    run = fit(TINY, prepared, tmp_path / "run", device="cpu").parent
    export_run(run, tmp_path / "weights.safetensors")
    start = Initialization(load_checkpoint(tmp_path / "weights.safetensors").network, {"name": "weights"})
    with pytest.raises(ValueError, match="from another start"):
        fit(TINY, prepared, run, start=start, device="cpu")
    with pytest.raises(ValueError, match="another architecture"):
        fit(TINY.replace(network={"width": 2}), prepared, tmp_path / "wide", start=start, device="cpu")
    assert not (tmp_path / "wide").exists()


def test_a_run_can_be_extended_and_not_cut_short(prepared: PreparedSet, tmp_path: Path):
    said: list[str] = []
    short, longer = TINY.replace(optimizer={"steps": 3}), TINY.replace(optimizer={"steps": 5})
    fit(short, prepared, tmp_path, device="cpu", on_message=said.append)
    assert not any("extended" in line for line in said)
    fit(longer, prepared, tmp_path, device="cpu", on_message=said.append)
    assert any("extended from 3 to 5 steps" in line for line in said)
    assert [int(row["step"]) for row in curve(tmp_path)] == [3, 5]
    assert json.loads((tmp_path / "run.json").read_text())["recipe"]["optimizer"]["steps"] == 5
    with pytest.raises(ValueError, match=r"optimizer\.steps is 5 there and 3 here"):
        fit(short, prepared, tmp_path, device="cpu")


def test_a_refused_run_names_what_differs(prepared: PreparedSet, mesh_folder: Path, tmp_path: Path):
    short = TINY.replace(optimizer={"steps": 1})
    fit(short, prepared, tmp_path / "run", device="cpu")
    with pytest.raises(ValueError, match=r"recipe\.seed is 0 there and 9 here\. Give"):
        fit(short.replace(seed=9), prepared, tmp_path / "run", device="cpu")
    other = short.replace(loss={"regularization": 3.0}, optimizer={"batch": 4})
    with pytest.raises(
        ValueError, match=r"loss\.regularization is 2\.0 there and 3\.0 here; recipe\.optimizer\.batch is"
    ):
        fit(other, prepared, tmp_path / "run", device="cpu")
    prepare([mesh_folder / "box"], tmp_path / "set", Options(), progress=False)
    with pytest.raises(ValueError, match=r"data\.\w+ is .+ there and .+ here"):
        fit(short, PreparedSet(tmp_path / "set"), tmp_path / "run", device="cpu")


def test_too_few_shapes_to_validate_are_told(prepared: PreparedSet, tmp_path: Path):
    short = TINY.replace(optimizer={"steps": 1})
    said: dict[float, str] = {}
    for share in (1e-6, 0.05, 0.6):
        lines: list[str] = []
        run = tmp_path / str(share)
        fit(short.replace(validation_share=share), prepared, run, device="cpu", on_message=lines.append)
        said[share] = " ".join(lines)
    assert len(prepared.split(1e-6)[1]) == 0
    assert "chosen on shapes that are trained on" in said[1e-6]
    few = len(prepared.split(0.05)[1])
    assert 0 < few < 20
    assert f"{few} shape" in said[0.05]
    assert "to validate with are too few" in said[0.05]
    assert len(prepared.split(0.6)[1]) >= 20
    assert "warning" not in said[0.6]
