"""What a run leaves in its folder: curve, log, checkpoints."""

import csv
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

import torch

COLUMNS: tuple[str, ...] = (
    "step", "loss", "symmetry", "regularization", "best_plane", "learning_rate", "gradient_norm", "normal_std",
    "rotation_sine",
    "samples_per_second", "validation_loss", "validation_best_plane", "validation_plane", "validation_share",
    "supervision", "validation_supervision",
)  # fmt: skip


class Writer(Protocol):
    """Where curves go beside the CSV: a TensorBoard SummaryWriter fits."""

    def add_scalar(self, tag: str, scalar_value: float, global_step: int) -> Any:
        """Record one value."""


class RunLog:
    """`log.txt` of a run: a few lines with what one wants to know later; ``echo`` is called with each of them."""

    def __init__(self, path: Path, echo: Callable[[str], None] | None = None) -> None:
        self._path = path
        self._echo = echo

    def say(self, message: str) -> None:
        """Write a line with the time before it."""
        with self._path.open("a", encoding="utf-8") as lines:
            lines.write(f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} {message}\n")
        if self._echo is not None:
            self._echo(message)


def save(path: Path, state: dict[str, Any]) -> None:
    """Write aside and rename, so that an interruption never leaves half a checkpoint."""
    aside = path.with_suffix(".tmp")
    torch.save(state, aside)
    aside.replace(path)


def append(path: Path, row: dict[str, float], writer: Writer | None) -> None:
    """Add a line to a curve."""
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


def trim(path: Path, step: int) -> None:
    """Drop lines that a killed run wrote after its last checkpoint: they will be written again."""
    if not path.is_file():
        return
    with path.open(newline="") as lines:
        rows = [row for row in csv.DictReader(lines) if int(row["step"]) <= step]
    with path.open("w", newline="") as lines:
        out = csv.DictWriter(lines, COLUMNS, restval="")
        out.writeheader()
        out.writerows(rows)
