"""Training: one recipe, one prepared set, one device. Needs torch and numpy alone.

Every random number of a step comes from a generator seeded with (seed, step), so a run that was interrupted
goes on exactly as if it had not been.
"""

import csv
import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

from model.network import PRSNet
from training.inputs import draw_inputs, voxels_of
from training.losses import Losses, combine, reflections, rotation_matrices
from training.prepared import PreparedSet
from training.pretraining import PlaneLabels, supervised
from training.recipe import OptimizerRecipe, Recipe
from training.revision import git_revision
from training.store import ShapeStore

VALIDATION_SHAPES = 512
_VALIDATION_SEED = 20_190_419
COLUMNS: tuple[str, ...] = (
    "step", "loss", "symmetry", "regularization", "best_plane", "learning_rate", "gradient_norm", "turn", "half_turn",
    "samples_per_second", "validation_loss", "validation_best_plane", "validation_plane", "validation_share",
    "supervision", "validation_supervision",
)  # fmt: skip


class Writer(Protocol):
    """Where curves go beside the CSV: a TensorBoard SummaryWriter fits."""

    def add_scalar(self, tag: str, scalar_value: float, global_step: int) -> Any:
        """Record one value."""


@dataclass(slots=True)
class Progress:
    """What a progress bar shows after a step."""

    step: int
    steps: int
    loss: float
    samples_per_second: float
    seconds_left: float


@dataclass(slots=True)
class Batch:
    """One batch: its losses, and what was predicted in the fed frame, detached.

    ``planes`` ``(b, p, 4)``, ``quaternions`` ``(b, r, 4)``; ``supervision`` is the supervised loss before its weight,
    which is no part of the losses, 0 without labels.
    """

    losses: Losses
    planes: Tensor
    quaternions: Tensor
    supervision: Tensor


def batch_losses(
    network: PRSNet,
    store: ShapeStore,
    shapes: Tensor,
    recipe: Recipe,
    generator: torch.Generator,
    labels: PlaneLabels | None = None,
) -> Batch:
    """Draw inputs for ``shapes`` ``(b,)``, run the network, evaluate the loss in the canonical frame.

    The predicted transforms are turned back into the canonical frame and act on the samples there; the transformed
    points are looked up in the canonical closest-point grid, so no grid is ever recomputed.
    """
    fed, pose = draw_inputs(store.meshes(shapes), recipe.input, recipe.damage, generator)
    voxels = voxels_of(fed, recipe.network.resolution).contiguous(memory_format=torch.channels_last_3d)
    samples = store.draw_samples(shapes, recipe.loss.samples, generator)
    planes, quaternions = network(voxels)
    mirrors, shifts = reflections(planes)
    linear = torch.cat([mirrors, rotation_matrices(quaternions)], dim=1)
    shift = torch.cat([shifts, quaternions.new_zeros((*quaternions.shape[:2], 3))], dim=1)
    linear, shift = pose.to_canonical(linear, shift)
    heads = linear.shape[1]
    # All heads in one product: the columns are (head, coordinate).
    columns = linear.permute(0, 3, 1, 2).flatten(2)
    transformed = torch.baddbmm(shift.flatten(1)[:, None], samples, columns).view(len(shapes), -1, 3)
    closest = store.closest(shapes, transformed.detach())
    distances = (transformed - closest).square().sum(-1)
    if not recipe.loss.squared:
        distances = (distances + 1e-12).sqrt()
    if recipe.loss.mask_occupied:
        distances = distances.masked_fill(store.occupied(transformed.detach(), closest), 0.0)
    distances = distances.unflatten(1, (recipe.loss.samples, heads))
    losses = combine(distances, planes, quaternions, recipe.loss.regularization, recipe.loss.best_head)
    guided = planes.new_zeros(()) if labels is None else supervised(labels, shapes, planes, pose, recipe.supervision)
    return Batch(losses, planes.detach(), quaternions.detach(), guided)


def learning_rate(recipe: OptimizerRecipe, step: int) -> float:
    """The rate of a step, a function of the step alone."""
    if recipe.schedule == "constant":
        return recipe.learning_rate
    warm = max(1, round(recipe.warmup * recipe.steps))
    if step < warm:
        return recipe.learning_rate * (0.04 + 0.96 * step / warm)
    done = (step - warm) / max(1, recipe.steps - warm)
    return recipe.learning_rate * 0.5 * (1.0 + math.cos(math.pi * min(1.0, done)))


def draw_shapes(pool: Tensor, recipe: Recipe, step: int) -> Tensor:
    """The shapes of a step: epochs of shuffled training indices, cut into batches; the last, short one is left out."""
    batch = min(recipe.optimizer.batch, len(pool))
    per_epoch = len(pool) // batch
    epoch, within = divmod(step, per_epoch)
    order = np.random.default_rng([recipe.seed, epoch]).permutation(len(pool))
    return pool[torch.from_numpy(order[within * batch : (within + 1) * batch]).to(pool.device)]


@torch.no_grad()
def validate(
    network: PRSNet, store: ShapeStore, shapes: Tensor, recipe: Recipe, labels: PlaneLabels | None = None
) -> dict[str, float]:
    """Losses on held-out shapes, always the same inputs; errors come from the training grid and are biased up."""
    network.eval()
    generator = torch.Generator(store.device).manual_seed(_VALIDATION_SEED)
    total, guided, planes = 0.0, 0.0, []
    for chunk in shapes.split(64):
        batch = batch_losses(network, store, chunk, recipe, generator, labels)
        total += float(batch.losses.total) * len(chunk)
        guided += float(batch.supervision) * len(chunk)
        planes.append(batch.losses.plane_errors)
    network.train()
    errors = torch.cat(planes)
    best = errors.amin(1)
    measured = {
        "validation_loss": total / len(shapes),
        "validation_best_plane": float(best.mean()),
        "validation_plane": float(errors.mean()),
        "validation_share": float((best <= 4e-4).float().mean()),
    }
    return measured if labels is None else {**measured, "validation_supervision": guided / len(shapes)}


def fit(
    recipe: Recipe,
    prepared: PreparedSet,
    run: str | Path,
    *,
    device: str | None = None,
    log_every: int = 100,
    validate_every: int = 1000,
    max_seconds: float | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    on_derive: Callable[[int, int], None] | None = None,
    writer: Writer | None = None,
) -> Path:
    """Train, or go on where ``run`` stopped.

    Args:
        recipe: what to train and how; a resumed run must be given the same one.
        prepared: the data.
        run: folder of the run: `run.json` (recipe and data), `revision`, `curve.csv`, `last.pt`, `best.pt` (lowest
            validation loss).
        device: ``cuda``, ``cpu``, ...; by default a GPU where there is one.
        log_every: steps between lines of the curve.
        validate_every: steps between validations; also how often `last.pt` is written.
        max_seconds: stop (with a checkpoint to resume from) after this long.
        on_progress: called after every logged step.
        on_derive: called with done and total while closest-point grids are derived.
        writer: further curves.

    Returns:
        the path of the best checkpoint.

    Raises:
        ValueError: ``run`` holds a run of another recipe or other data, there is nothing to train on, or there are no
            labels where the recipe asks for them.
    """
    run = Path(run)
    run.mkdir(parents=True, exist_ok=True)
    torch_device = torch.device(device or ("cuda" if torch.cuda.is_available() else "cpu"))
    data = {"manifest_sha256": prepared.sha256, "shapes": len(prepared), "skipped": prepared.manifest["skipped"]}
    labels = None
    if recipe.supervision.weight > 0:
        labels = PlaneLabels(prepared, torch_device, recipe.supervision.max_error)
        data["labels"] = prepared.labels
    identity = json.dumps({"recipe": recipe.to_dict(), "data": data}, indent=1, sort_keys=True)
    stamp = run / "run.json"
    if stamp.is_file() and stamp.read_text() != identity:
        raise ValueError(f"{run} holds a run of another recipe or other data; choose another folder")
    if not stamp.is_file():
        stamp.write_text(identity)
        (run / "revision").write_text(git_revision())
    train_index, validation_index = prepared.split(recipe.validation_share)
    if len(train_index) == 0:
        raise ValueError("the prepared set holds no shape to train on")
    store = ShapeStore(prepared, torch_device, recipe.loss.grid, on_derive)
    pool = torch.from_numpy(train_index).to(torch_device)
    held_out = torch.from_numpy(validation_index if len(validation_index) else train_index).to(torch_device)
    held_out = held_out[:VALIDATION_SHAPES]

    torch.manual_seed(recipe.seed)
    network = PRSNet(recipe.network).to(torch_device)
    network.to(memory_format=torch.channels_last_3d)  # pyright: ignore[reportCallIssue] - not in the stubs
    optimizer = torch.optim.Adam(network.parameters(), lr=recipe.optimizer.learning_rate)
    step, best = 0, math.inf
    if (run / "last.pt").is_file():
        state = torch.load(run / "last.pt", map_location=torch_device, weights_only=True)
        network.load_state_dict(state["network"])
        optimizer.load_state_dict(state["optimizer"])
        step, best = int(state["step"]), float(state["best"])
        _trim_curve(run / "curve.csv", step)
    network.train()
    started = mark = time.monotonic()
    marked_step = step
    generator = torch.Generator(torch_device)
    steps = recipe.optimizer.steps
    while step < steps:
        rate = learning_rate(recipe.optimizer, step)
        for group in optimizer.param_groups:
            group["lr"] = rate
        generator.manual_seed(recipe.seed * 1_000_003 + step)
        batch = batch_losses(network, store, draw_shapes(pool, recipe, step), recipe, generator, labels)
        losses = batch.losses
        total = losses.total + recipe.supervision.weight_at(step) * batch.supervision
        optimizer.zero_grad(set_to_none=True)
        total.backward()
        limit = recipe.optimizer.clip_norm or math.inf
        norm = torch.nn.utils.clip_grad_norm_(network.parameters(), limit)
        optimizer.step()
        step += 1
        stopping = max_seconds is not None and time.monotonic() - started > max_seconds
        validating = step % validate_every == 0 or step == steps or stopping
        if step % log_every == 0 or validating:
            now = time.monotonic()
            speed = (step - marked_step) * recipe.optimizer.batch / max(now - mark, 1e-9)
            mark, marked_step = now, step
            row: dict[str, float] = {
                "step": step,
                "loss": float(total.detach()),
                "symmetry": float(losses.symmetry),
                "regularization": float(losses.regularization),
                "best_plane": float(losses.plane_errors.amin(1).mean()),
                "learning_rate": rate,
                "gradient_norm": float(norm),
                # Collapse monitors: how much the normals vary over the batch, and the mean sine of half the angle.
                "turn": float(batch.planes[..., :3].std(0).mean()),
                "half_turn": float(batch.quaternions[..., 1:].norm(dim=-1).mean())
                if batch.quaternions.numel()
                else 0.0,
                "samples_per_second": speed,
            }
            if labels is not None:
                row["supervision"] = float(batch.supervision.detach())
            if not math.isfinite(row["loss"]):
                raise FloatingPointError(f"the loss is not finite at step {step}; lower the learning rate")
            if validating:
                row |= validate(network, store, held_out, recipe, labels)
                state = {"network": network.state_dict(), "optimizer": optimizer.state_dict(), "step": step}
                if row["validation_loss"] < best:
                    best = row["validation_loss"]
                    _save(run / "best.pt", {"network": network.state_dict(), "step": step, "metrics": row})
                _save(run / "last.pt", {**state, "best": best, "metrics": row})
            _log(run / "curve.csv", row, writer)
            if on_progress is not None:
                left = (steps - step) * recipe.optimizer.batch / max(speed, 1e-9)
                on_progress(Progress(step, steps, row["loss"], speed, left))
        if stopping:
            break
    return run / "best.pt"


def _save(path: Path, state: dict[str, Any]) -> None:
    """Write aside and rename, so that an interruption never leaves half a checkpoint."""
    aside = path.with_suffix(".tmp")
    torch.save(state, aside)
    aside.replace(path)


def _log(path: Path, row: dict[str, float], writer: Writer | None) -> None:
    fresh = not path.is_file()
    with path.open("a", newline="") as lines:
        out = csv.DictWriter(lines, COLUMNS, restval="")
        if fresh:
            out.writeheader()
        out.writerow({key: f"{value:.6g}" for key, value in row.items()})
    if writer is not None:
        for key, value in row.items():
            if key != "step":
                writer.add_scalar(key, value, int(row["step"]))


def _trim_curve(path: Path, step: int) -> None:
    """Drop lines a killed run wrote after its last checkpoint: they will be written again."""
    if not path.is_file():
        return
    with path.open(newline="") as lines:
        rows = [row for row in csv.DictReader(lines) if int(row["step"]) <= step]
    with path.open("w", newline="") as lines:
        out = csv.DictWriter(lines, COLUMNS, restval="")
        out.writeheader()
        out.writerows(rows)
