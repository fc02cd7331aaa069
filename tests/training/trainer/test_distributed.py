"""Two processes train what one does: same batch, same random numbers, same statistics, gradients averaged."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
from torch import nn

from model.network.network import PRSNet
from training.data.prepared import PreparedSet
from training.data.store import ShapeStore
from training.inputs.inputs import voxels_of
from training.recipe import Recipe
from training.trainer.distributed import World, share_statistics
from training.trainer.fit import fit

ROOT = Path(__file__).parents[3]

# Few samples: each has a chance to lie so near to a cell's side that rounding decides in which one, and Adam makes much
# of such a difference.
RECIPE = """
name = "shared"
seed = 1
validation_share = 0.2
[network]
resolution = 8
batch_norm = true
[input]
frame = "inertia"
[damage]
share = 0.5
[loss]
samples = 8
grid = 32
[optimizer]
steps = 6
batch = 8
learning_rate = 0.005
clip_norm = 500.0
"""

TRAINING = ("-m", "--", "training")  # without --, torchrun takes --run for its own


def torchrun(processes: int, *arguments: object, restarts: int = 0) -> "subprocess.Popen[str]":
    """`torchrun ...` on this machine alone."""
    start = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", str(processes)]
    start += ["--max-restarts", str(restarts), "--monitor-interval", "0.1"]
    command = [*start, *map(str, arguments)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        command, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )


def succeeds(process: "subprocess.Popen[str]") -> None:
    try:
        _, errors = process.communicate(timeout=240)
    finally:
        process.kill()
    assert process.returncode == 0, errors


def predictions(run: Path, prepared: PreparedSet) -> torch.Tensor:
    """Planes and quaternions of the last checkpoint for shapes of the set, with the statistics of these shapes.

    They and not the weights are compared: a bias in front of a batch normalisation has no gradient but rounding, which
    Adam makes as large as any other, and running averages follow it late.
    """
    network = PRSNet(Recipe.from_dict(json.loads((run / "run.json").read_text())["recipe"]).network)
    network.load_state_dict(torch.load(run / "last.pt", weights_only=True)["network"])
    store = ShapeStore(prepared, torch.device("cpu"), 32)
    with torch.no_grad():
        return torch.cat(network.train()(voxels_of(store.meshes(torch.arange(24) * 4), 8)), dim=1)


def test_two_processes_end_where_one_does(prepared: PreparedSet, tmp_path: Path):
    toml = tmp_path / "recipe.toml"
    toml.write_text(RECIPE)
    fit(Recipe.load(toml), prepared, tmp_path / "one", device="cpu", log_every=1)
    options = ("--recipe", toml, "--device", "cpu", "--no-tensorboard")
    succeeds(torchrun(2, *TRAINING, "fit", prepared.root, "--run", tmp_path / "two", *options))
    one, two = (predictions(tmp_path / name, prepared) for name in ("one", "two"))
    torch.testing.assert_close(two, one, rtol=0.0, atol=1e-4)
    # Training has moved them by far more than that.
    assert (one[:, :3, :3] - torch.eye(3)).abs().max() > 1e-2
    # The curve is that of the whole batch, and one process alone wrote it.
    with (tmp_path / "one" / "curve.csv").open() as lines, (tmp_path / "two" / "curve.csv").open() as others:
        last, rows = list(csv.DictReader(lines))[-1], list(csv.DictReader(others))
    assert [row["step"] for row in rows] == ["6"]
    for key in ("loss", "best_plane", "gradient_norm", "normal_std", "rotation_sine", "validation_loss"):
        assert float(rows[0][key]) == pytest.approx(float(last[key]), rel=2e-3, abs=1e-6), key
    assert "2 process(es)" in (tmp_path / "two" / "log.txt").read_text()
    # And it is the same run: one process finds nothing left to do in the folder of two.
    fit(Recipe.load(toml), prepared, tmp_path / "two", device="cpu")


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_run_leaves_no_thread_that_could_outlive_the_interpreter(prepared: PreparedSet, tmp_path: Path):
    """A thread of gloo's that needs Python while it is being torn down aborts the process (once in many runs)."""
    toml, script = tmp_path / "recipe.toml", tmp_path / "ended.py"
    toml.write_text(RECIPE.replace("steps = 6", "steps = 2"))
    script.write_text("""
import os
import sys
from pathlib import Path

from training.data.prepared import PreparedSet
from training.recipe import Recipe
from training.trainer.fit import fit

recipe, prepared, run = map(Path, sys.argv[1:])
fit(Recipe.load(recipe), PreparedSet(prepared), run, device="cpu")
threads = [Path("/proc/self/task", task, "comm").read_text().strip() for task in os.listdir("/proc/self/task")]
run.with_name("threads-" + os.environ["RANK"]).write_text(" ".join(name for name in threads if "gloo" in name))
""")
    succeeds(torchrun(2, script, toml, prepared.root, tmp_path / "run"))
    assert [(tmp_path / f"threads-{rank}").read_text() for rank in range(2)] == ["", ""]


@pytest.mark.skipif(os.environ.get("TEST_CLUSTER") != "1", reason="slow: `make cluster` runs it")
def test_a_process_is_killed_and_the_run_ends_as_if_none_had_been(prepared: PreparedSet, tmp_path: Path):
    """`torchrun` starts all processes again, and they go on from the last checkpoint."""
    toml, steps = tmp_path / "recipe.toml", 20
    toml.write_text(RECIPE.replace("steps = 6", f"steps = {steps}").replace("rate = 0.005", "rate = 0.0005"))
    run = tmp_path / "killed"
    options = ("--recipe", toml, "--device", "cpu", "--no-tensorboard", "--validate-every", 4)
    process = torchrun(2, *TRAINING, "fit", prepared.root, "--run", run, *options, restarts=2)
    end = time.monotonic() + 120
    while not (run / "last.pt").is_file():
        assert process.poll() is None, process.stderr and process.stderr.read()
        assert time.monotonic() < end
        time.sleep(0.005)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    victim = max(map(int, children))
    os.kill(victim, signal.SIGKILL)
    succeeds(process)
    log = (run / "log.txt").read_text()
    assert log.count("2 process(es)") == 2
    resumed = int(log.split("resumed at step ")[1].split(":")[0])
    assert 4 <= resumed < steps
    assert [int(row["step"]) for row in rows_of(run)] == list(range(4, steps + 1, 4))
    # The same run as without the accident ...
    succeeds(torchrun(2, *TRAINING, "fit", prepared.root, "--run", tmp_path / "two", *options))
    two, killed = (predictions(folder, prepared) for folder in (tmp_path / "two", run))
    assert (killed - two).abs().max() < 1e-5
    # ... and that of one process, but for what 20 steps make of another order of summation.
    fit(Recipe.load(toml), prepared, tmp_path / "one", device="cpu", validate_every=4)
    for row, other in zip(rows_of(tmp_path / "one"), rows_of(run), strict=True):
        assert float(other["validation_loss"]) == pytest.approx(float(row["validation_loss"]), rel=2e-3)


def rows_of(run: Path) -> list[dict[str, str]]:
    with (run / "curve.csv").open() as lines:
        return list(csv.DictReader(lines))


def test_a_batch_that_cannot_be_divided_is_refused():
    world = World(torch.device("cpu"), rank=1, size=3)
    assert world.part(12) == slice(4, 8)
    with pytest.raises(ValueError, match="a batch of 32 cannot be divided evenly among 3 processes"):
        world.part(32)


@pytest.mark.parametrize("kind", [nn.BatchNorm1d, nn.BatchNorm3d])
def test_shared_statistics_of_one_process_are_those_of_torch(kind: type[nn.Module], tmp_path: Path):
    """A group of one: forward, backward and running statistics as torch's own layer has them."""
    shape = (6, 3) if kind is nn.BatchNorm1d else (6, 3, 2, 4, 2)
    inputs = torch.randn(shape, generator=torch.Generator().manual_seed(1)) * 3.0 + 1.0
    layers = [nn.Sequential(kind(3)) for _ in range(2)]
    nn.init.uniform_(layers[0][0].weight, 0.5, 2.0)
    layers[1].load_state_dict(layers[0].state_dict())
    share_statistics(layers[1])
    torch.distributed.init_process_group("gloo", init_method=f"file://{tmp_path / 'meet'}", rank=0, world_size=1)
    try:
        outputs, gradients = [], []
        for layer in layers:
            fed = inputs.clone().requires_grad_()
            output = layer(fed)
            (output**3).sum().backward()
            outputs.append(output.detach())
            gradients.append(fed.grad)
        for layer in layers:
            layer.eval()
        torch.testing.assert_close(layers[1](inputs), layers[0](inputs))
    finally:
        torch.distributed.destroy_process_group()
    torch.testing.assert_close(outputs[1], outputs[0])
    torch.testing.assert_close(gradients[1], gradients[0], rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(layers[1].state_dict(), layers[0].state_dict())
