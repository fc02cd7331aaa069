"""Training: one recipe, prepared data, one process or several. Needs torch and numpy alone.

Every random number of a step comes from a generator seeded with (seed, step), so a run that was interrupted
goes on exactly as if it had not been.
"""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from model.network.network import PRSNet
from training.data.batch_sampler import Sampler
from training.data.prepared import PreparedSet
from training.data.store import ShapeStore
from training.recipe import OptimizerRecipe, Recipe
from training.trainer.claim import claim
from training.trainer.distributed import World, join
from training.trainer.monitor import CollapseMonitor, memory_in_use
from training.trainer.objective import Batch, batch_losses, validate
from training.trainer.precision import Precision, keep_small_layers_exact
from training.trainer.records import RunLog, Writer, append, save, trim
from training.trainer.supervision import PlaneLabels

VALIDATION_SHAPES = 512
FEW_SHAPES = 20
"""With fewer to validate on, which checkpoint is the best is chance."""

EARLY_STEPS = 20
"""Speed and memory are logged after so many steps: whoever sees that a run takes too long can end it early."""


@dataclass(frozen=True, slots=True)
class Initialization:
    """Weights to begin with: a trained ``network``, and the ``record`` of it that the run keeps."""

    network: PRSNet
    record: Mapping[str, str]


@dataclass(slots=True)
class Progress:
    """What a progress bar shows after a step."""

    step: int
    steps: int
    loss: float
    samples_per_second: float
    seconds_left: float


def learning_rate(recipe: OptimizerRecipe, step: int) -> float:
    """The rate of a step, a function of the step alone."""
    if recipe.schedule == "constant":
        return recipe.learning_rate
    warm = max(1, round(recipe.warmup * recipe.steps))
    if step < warm:
        return recipe.learning_rate * (0.04 + 0.96 * step / warm)
    done = (step - warm) / max(1, recipe.steps - warm)
    return recipe.learning_rate * 0.5 * (1.0 + math.cos(math.pi * min(1.0, done)))


def fit(
    recipe: Recipe,
    prepared: PreparedSet,
    run: str | Path,
    *,
    start: Initialization | None = None,
    device: str | None = None,
    precision: Precision = "float32",
    log_every: int = 100,
    validate_every: int = 1000,
    max_seconds: float | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    on_derive: Callable[[int, int], None] | None = None,
    on_message: Callable[[str], None] | None = None,
    writer: Writer | None = None,
) -> Path:
    """Train, or go on where ``run`` stopped; among several processes where `torchrun` started them.

    Args:
        recipe: what to train and how; a resumed run must be given the same one, but for more steps. Its batch is that
            of all processes.
        prepared: the data.
        run: folder of the run: `run.json` (recipe and data), `revision`, `log.txt`, `curve.csv`, `last.pt`, `best.pt`
            (lowest validation loss). The main process alone writes.
        start: weights of the recipe's architecture to begin with instead of random ones, such as the shipped ones on
            other data. Statistics of batch normalisation come with them; the optimiser starts anew.
        device: ``cuda``, ``cpu``, ...; by default a GPU where there is one.
        precision: ``bf16`` runs the convolutions in bfloat16; the loss stays in float32.
        log_every: steps between lines of the curve.
        validate_every: steps between validations; also how often `last.pt` is written.
        max_seconds: stop (with a checkpoint to resume from) after this long.
        on_progress: called after every logged step.
        on_derive: called with done and total while closest-point grids are derived.
        on_message: called with every line of `log.txt`.
        writer: further curves.

    Returns:
        the path of the best checkpoint.

    Raises:
        ValueError: ``run`` holds a run of another recipe or other data or from another start, there is nothing to train
            on, there are no labels where the recipe asks for them, ``start`` is of another architecture, or the batch
            cannot be divided among the processes.
        CollapseError: the predictions have not followed the input for a large part of the run.
        FloatingPointError: the loss or the gradient is not finite.
    """
    world = join(device)

    def train() -> Path:  # of which nothing may be left when the group of processes is closed
        trainer = _Trainer(recipe, prepared, Path(run), start, world, precision, on_derive, on_message)
        return trainer.train(log_every, validate_every, max_seconds, on_progress, writer)

    try:
        return train()
    finally:
        world.close()


class _Trainer:
    """A run in the memory of one process."""

    def __init__(
        self,
        recipe: Recipe,
        prepared: PreparedSet,
        run: Path,
        start: Initialization | None,
        world: World,
        precision: Precision,
        on_derive: Callable[[int, int], None] | None,
        on_message: Callable[[str], None] | None,
    ) -> None:
        self.recipe, self.run, self.world = recipe, run, world
        self.precision: Precision = precision
        self.labels = (
            PlaneLabels(prepared, world.device, recipe.supervision.max_error) if recipe.supervision.weight > 0 else None
        )
        train_index, validation_index = prepared.split(recipe.validation_share)
        self.sampler = Sampler(prepared, train_index, recipe)
        world.part(self.sampler.batch)
        if start is not None and start.network.architecture != recipe.network:
            raise ValueError(f"{start.record['name']} has another architecture than the recipe")
        extended = self._claim(prepared, start)
        self.log = RunLog(run / "log.txt", on_message) if world.main else None
        pieces = recipe.damage.scans > 0
        self.store = world.in_turn(lambda: ShapeStore(prepared, world.device, recipe.loss.grid, on_derive, pieces))
        held_out = torch.from_numpy(validation_index if len(validation_index) else train_index)
        self.held_out = held_out[:VALIDATION_SHAPES].to(world.device)

        torch.manual_seed(recipe.seed)
        self.network = PRSNet(recipe.network).to(world.device)
        if start is not None:
            self.network.load_state_dict(start.network.state_dict())
        self.network.to(memory_format=torch.channels_last_3d)  # pyright: ignore[reportCallIssue] - not in the stubs
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=recipe.optimizer.learning_rate)
        self.step, self.best = 0, math.inf
        state = world.shared(_last(run) if world.main else None)  # the folder is the main process's alone
        if state is not None:
            self.network.load_state_dict(state["network"])
            self.optimizer.load_state_dict(state["optimizer"])
            self.step, self.best = int(state["step"]), float(state["best"])
            if world.main:
                trim(run / "curve.csv", self.step)
        if precision != "float32":
            keep_small_layers_exact(self.network)
        self.wrapped = world.wrapped(self.network)
        verb = f"resumed at step {self.step}" if self.step else "began"
        self._say(
            f"{verb}: {recipe.name}, {len(train_index)} shapes to train on, {len(self.held_out)} to validate with, "
            f"{world.size} process(es), {world.device.type}, {precision}, torch {torch.__version__}"
        )
        if extended is not None:
            self._say(extended)
        if len(validation_index) < FEW_SHAPES:
            self._say(f"warning: {_too_few(len(validation_index), recipe.validation_share)}")

    def _claim(self, prepared: PreparedSet, start: Initialization | None) -> str | None:
        """Make the folder that of this recipe and these data, or find that it is; what to say about it."""
        if not self.world.main:
            return None
        data = prepared.record() | ({"labels": prepared.labels} if self.labels is not None else {})
        data |= {"views": prepared.views} if self.recipe.damage.scans > 0 else {}
        record: dict[str, Any] = {"recipe": self.recipe.to_dict(), "data": data}
        if start is not None:
            record["start"] = dict(start.record)
        return claim(self.run, record)

    def train(
        self,
        log_every: int,
        validate_every: int,
        max_seconds: float | None,
        on_progress: Callable[[Progress], None] | None,
        writer: Writer | None,
    ) -> Path:
        """The loop; see `fit`."""
        recipe, world = self.recipe, self.world
        monitor = CollapseMonitor(recipe.optimizer.steps, recipe.network.rotations > 0)
        self.network.train()
        generator = torch.Generator(world.device)
        started = mark = time.monotonic()
        marked_step = first_step = self.step
        steps = recipe.optimizer.steps
        while self.step < steps:
            rate = learning_rate(recipe.optimizer, self.step)
            for group in self.optimizer.param_groups:
                group["lr"] = rate
            generator.manual_seed(recipe.seed * 1_000_003 + self.step)
            shapes = self.sampler.draw(self.step).to(world.device)
            batch = batch_losses(
                self.wrapped, self.store, shapes, recipe, generator, self.labels, world, self.precision
            )
            total = batch.losses.total + recipe.supervision.weight_at(self.step) * batch.supervision
            self.optimizer.zero_grad(set_to_none=True)
            total.backward()
            limit = recipe.optimizer.clip_norm or math.inf
            norm = torch.nn.utils.clip_grad_norm_(self.network.parameters(), limit)
            self.optimizer.step()
            self.step += 1
            if self.step == first_step + EARLY_STEPS:
                speed = EARLY_STEPS * self.sampler.batch / (time.monotonic() - started)
                self._say(f"after {EARLY_STEPS} steps: {speed:.0f} samples/s, {memory_in_use(world.device)}")
            stopping = max_seconds is not None and world.agreed(time.monotonic() - started > max_seconds)
            validating = self.step % validate_every == 0 or self.step == steps or stopping
            if self.step % log_every == 0 or validating:
                now = time.monotonic()
                speed = (self.step - marked_step) * self.sampler.batch / max(now - mark, 1e-9)
                mark, marked_step = now, self.step
                row = self._row(batch, total, float(norm), rate, speed)
                warning = monitor.check(row)
                if world.main:
                    if warning is not None:
                        self._say(f"warning: {warning}")
                    if validating:
                        self._keep(row)
                    append(self.run / "curve.csv", row, writer)
                    if on_progress is not None:
                        left = (steps - self.step) * self.sampler.batch / max(speed, 1e-9)
                        on_progress(Progress(self.step, steps, row["loss"], speed, left))
            if stopping:
                break
        self._say(f"ended at step {self.step} after {(time.monotonic() - started) / 60:.1f} minutes")
        return self.run / "best.pt"

    def _row(self, batch: Batch, total: Tensor, norm: float, rate: float, speed: float) -> dict[str, float]:
        """A line of the curve, over the parts of all processes."""
        losses, world = batch.losses, self.world
        best = losses.plane_errors.amin(1).mean()
        means = world.mean(torch.stack([total, losses.symmetry, losses.regularization, best, batch.supervision]))
        planes, quaternions = world.joined(batch.planes), world.joined(batch.quaternions)
        row: dict[str, float] = {
            "step": self.step,
            **dict(zip(("loss", "symmetry", "regularization", "best_plane"), means.tolist(), strict=False)),
            "learning_rate": rate,
            "gradient_norm": norm,
            # Collapse monitors: how much the normals vary over the batch, and the mean sine of half the angle.
            "normal_std": float(planes[..., :3].std(0).mean()),
            "rotation_sine": float(quaternions[..., 1:].norm(dim=-1).mean()) if quaternions.numel() else 0.0,
            "samples_per_second": speed,
        }
        return row if self.labels is None else {**row, "supervision": float(means[4])}

    def _keep(self, row: dict[str, float]) -> None:
        """Validate, and write checkpoints; what was measured is added to ``row``."""
        row |= validate(self.network, self.store, self.held_out, self.recipe, self.labels)
        state = {"network": self.network.state_dict(), "optimizer": self.optimizer.state_dict(), "step": self.step}
        if row["validation_loss"] < self.best:
            self.best = row["validation_loss"]
            save(self.run / "best.pt", {"network": state["network"], "step": self.step, "metrics": row})
        save(self.run / "last.pt", {**state, "best": self.best, "metrics": row})

    def _say(self, message: str) -> None:
        if self.log is not None:
            self.log.say(message)


def _too_few(count: int, share: float) -> str:
    if count == 0:
        return (
            f"the set is too small to keep a share of {share:g} for validation; the best checkpoint is chosen on "
            "shapes that are trained on. Take more shapes, or a larger --set validation_share=..."
        )
    shapes = "1 shape" if count == 1 else f"{count} shapes"
    return (
        f"{shapes} to validate with are too few to tell which checkpoint is the best. Take more shapes, or a larger "
        "--set validation_share=..."
    )


def _last(run: Path) -> dict[str, Any] | None:
    """The checkpoint to go on from, on the CPU; None where there is none."""
    path = run / "last.pt"
    return torch.load(path, map_location="cpu", weights_only=True) if path.is_file() else None
