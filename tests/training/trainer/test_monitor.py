"""A network that collapses is noticed and its run ended; a healthy one is left alone. Precision and the log."""

from pathlib import Path

import pytest
import torch
from torch import nn
from typer.testing import CliRunner

from model.network.architecture import Architecture
from model.network.network import PRSNet
from training import __main__ as cli
from training.data.prepared import PreparedSet
from training.recipe import Recipe
from training.trainer import fit as module
from training.trainer.fit import fit
from training.trainer.monitor import CollapseError, CollapseMonitor, memory_in_use
from training.trainer.precision import keep_small_layers_exact, mixed

TINY = Recipe.from_dict({
    "name": "tiny",
    "validation_share": 0.1,
    "network": {"resolution": 8, "batch_norm": True},
    "input": {"frame": "inertia", "jitters": [0.35], "jitter_shares": [1.0]},
    "loss": {"samples": 50},
    "optimizer": {"steps": 40, "batch": 8, "learning_rate": 0.005},
})  # fmt: skip


def row(step: int, **values: float) -> dict[str, float]:
    return {"step": step, "loss": 1.0, "gradient_norm": 1.0, "normal_std": 0.1, "rotation_sine": 0.9, **values}


def lasting(monitor: CollapseMonitor, until: int, **values: float) -> list[str]:
    return [said for step in range(100, until + 1, 100) if (said := monitor.check(row(step, **values)))]


@pytest.mark.parametrize("key", ["normal_std", "rotation_sine"])
def test_a_long_standstill_warns_once_and_then_ends_the_run(key: str):
    monitor = CollapseMonitor(10_000, rotations=True)
    assert monitor.patience == 1500
    said = lasting(monitor, 1500, **{key: 1e-5})
    assert len(said) == 1
    assert "for 800 steps" in said[0]
    with pytest.raises(CollapseError, match="the network has collapsed"):
        monitor.check(row(1600, **{key: 1e-5}))


def test_a_late_start_is_no_collapse():
    """The curve of the shipped paper recipe: it stood at its initial planes for 500 of 12,000 steps."""
    monitor = CollapseMonitor(12_000, rotations=True)
    assert not lasting(monitor, 500, normal_std=1e-6)
    assert monitor.check(row(600, normal_std=0.15)) is None
    # And the count begins anew.
    assert not [said for step in range(700, 1300, 100) if (said := monitor.check(row(step, normal_std=1e-6)))]


def test_without_rotations_nothing_is_asked_of_them():
    assert not lasting(CollapseMonitor(1000, rotations=False), 5000, half_normal_std=0.0)


@pytest.mark.parametrize("key", ["loss", "gradient_norm"])
def test_what_is_not_finite_ends_the_run(key: str):
    with pytest.raises(FloatingPointError, match="not finite at step 7"):
        CollapseMonitor(10, rotations=True).check(row(7, **{key: float("nan")}))


def impatient(steps: int, rotations: bool) -> CollapseMonitor:
    monitor = CollapseMonitor(steps, rotations)
    monitor.patience = 16
    return monitor


def test_a_network_that_ignores_its_input_is_noticed(
    prepared: PreparedSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(module, "CollapseMonitor", impatient)
    # Healthy: within a few steps the planes move with the input.
    fit(TINY, prepared, tmp_path / "healthy", device="cpu", log_every=4)
    log = (tmp_path / "healthy" / "log.txt").read_text()
    assert "ended at step 40" in log
    assert "have not depended on the input" not in log
    # One that is blind: whatever it is shown, it sees the same.
    forward = PRSNet.forward
    monkeypatch.setattr(
        PRSNet, "forward", lambda network, voxels: forward(network, voxels[:1].expand_as(voxels).contiguous())
    )
    with pytest.raises(CollapseError, match="have not depended on the input"):
        fit(TINY, prepared, tmp_path / "dead", device="cpu", log_every=4)
    assert "warning: the predicted planes have not depended on the input" in (tmp_path / "dead" / "log.txt").read_text()
    # On the command line: a sentence and a status, no traceback.
    (tmp_path / "r.toml").write_text(
        'name = "r"\n[network]\nresolution = 8\n[loss]\nsamples = 50\n[optimizer]\nbatch = 8\n'
    )
    options = ["--device", "cpu", "--no-tensorboard", "--no-progress", "--steps", "2000"]
    monkeypatch.setattr(module, "batch_losses", lambda *_: (_ for _ in ()).throw(CollapseError("it has collapsed")))
    start = ["fit", str(prepared.root), "--run", str(tmp_path / "cli"), "--recipe", str(tmp_path / "r.toml")]
    result = CliRunner().invoke(cli.app, [*start, *options])
    assert result.exit_code == 1
    assert "The run was ended: it has collapsed" in result.output


def test_speed_and_memory_are_said_early(prepared: PreparedSet, tmp_path: Path):
    said: list[str] = []
    recipe = TINY.replace(optimizer={"steps": module.EARLY_STEPS})
    fit(recipe, prepared, tmp_path, device="cpu", on_message=said.append)
    early = next(line for line in said if line.startswith(f"after {module.EARLY_STEPS} steps"))
    assert "samples/s" in early
    assert memory_in_use(torch.device("cpu")).split(" of ")[0].split()[-1] in ("MB", "memory", "unknown")
    assert [line.split(" ", 2)[2] for line in (tmp_path / "log.txt").read_text().splitlines()] == said


def test_bfloat16_trains_and_its_planes_stay_exact(prepared: PreparedSet, tmp_path: Path):
    fit(TINY.replace(optimizer={"steps": 3}), prepared, tmp_path, device="cpu", precision="bf16", log_every=1)
    state = torch.load(tmp_path / "last.pt", weights_only=True)["network"]
    assert all(value.dtype in (torch.float32, torch.int64) for value in state.values())
    network = PRSNet(TINY.network)
    network.load_state_dict(state)
    voxels = (torch.rand((4, 1, 8, 8, 8), generator=torch.Generator().manual_seed(0)) < 0.2).float()
    exact, _ = network(voxels)
    keep_small_layers_exact(network)
    with mixed("bf16", torch.device("cpu")):
        seen: list[torch.dtype] = []
        network.features[4].register_forward_hook(lambda *parts: seen.append(parts[-1].dtype))
        planes, quaternions = network(voxels)
    assert seen == [torch.bfloat16]
    assert planes.dtype == quaternions.dtype == torch.float32
    assert not torch.equal(planes, exact)
    torch.testing.assert_close(planes, exact, atol=0.05, rtol=0.0)
    # Unit normals to seven digits, not to three.
    assert (planes[..., :3].norm(dim=-1) - 1.0).abs().max() < 1e-6


@pytest.mark.parametrize("architecture", [Architecture(), Architecture(channels=(8, 8, 16, 32, 96))])
def test_gradients_in_bfloat16_are_those_of_float32(architecture: Architecture):
    """On every processor, in every layer: kernels for bfloat16 differ from one to the next, and some are wrong."""
    network = PRSNet(architecture)
    keep_small_layers_exact(network)
    generator = torch.Generator().manual_seed(1)
    layers = [layer for layer in network.features if isinstance(layer, nn.Conv3d)]
    for depth, layer in enumerate(layers):
        size = architecture.resolution >> depth
        voxels = torch.randn((5, layer.in_channels, size, size, size), generator=generator)
        wanted = torch.randn((5, layer.out_channels, size, size, size), generator=generator)
        gradients: list[list[torch.Tensor]] = []
        for precision in ("float32", "bf16"):
            given = voxels.clone().requires_grad_()
            layer.zero_grad()
            with mixed(precision, torch.device("cpu")):
                found = layer(given)
            (found.float() * wanted).sum().backward()
            gradients.append([found.detach().float(), given.grad, layer.weight.grad, layer.bias.grad])
        for exact, rough in zip(*gradients, strict=True):
            assert (rough - exact).norm() < 0.02 * exact.norm(), (depth, size)
