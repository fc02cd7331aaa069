"""`training export`: the checkpoint of a run as shipped weights with their whole record."""

import csv
import json
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import torch

from model import __version__
from model.network.checkpoint import InputSpec, save_checkpoint
from model.network.network import PRSNet
from training.recipe import Recipe


def export_run(
    run: Path,
    out: Path,
    *,
    name: str | None = None,
    metrics: Sequence[Path] = (),
    which: str = "best",
    settings: Sequence[str] = (),
) -> None:
    """Write ``out`` (`.safetensors`) and its `.json`.

    Args:
        run: folder of the run.
        out: where the weights go.
        name: name in the metadata; the recipe's by default.
        metrics: JSON reports of `training evaluate`; they are kept whole, by file name.
        which: ``best`` (lowest validation loss) or ``last``.
        settings: how the detector is to use the weights, as in ``["passes=2", "sign_frames=8"]``, where that was
            chosen after training, on held-out shapes.

    Raises:
        ValueError: the folder holds no such checkpoint.
    """
    source = run / f"{which}.pt"
    if not source.is_file():
        raise ValueError(f"{run} holds no {which} checkpoint")
    identity = json.loads((run / "run.json").read_text())
    recipe = Recipe.from_dict(identity["recipe"]).with_settings([f"inference.{setting}" for setting in settings])
    state = torch.load(source, map_location="cpu", weights_only=True)
    network = PRSNet(recipe.network)
    network.load_state_dict(state["network"])
    spec = InputSpec(recipe.input.frame, **asdict(recipe.inference))
    metadata: dict[str, Any] = {
        "name": name or recipe.name,
        "version": __version__,
        "created": datetime.now(UTC).strftime("%Y-%m-%d"),
        "paper": "Gao et al., PRS-Net: Planar Reflective Symmetry Detection Net for 3D Models, TVCG 2020",
        "input": asdict(spec),
        "recipe": recipe.to_dict(),
        "seed": recipe.seed,
        "data": identity["data"],
        **({"start": identity["start"]} if "start" in identity else {}),
        "git_revision": (run / "revision").read_text(),
        "metrics": {
            "training": {"step": int(state["step"]), **state["metrics"]},
            **{report.stem: json.loads(report.read_text()) for report in metrics},
        },
    }
    save_checkpoint(out, network, metadata)


def read_curve(run: Path) -> list[dict[str, float]]:
    """The rows of a run's `curve.csv`; cells that were not measured are left out."""
    with (run / "curve.csv").open(newline="") as lines:
        return [{key: float(value) for key, value in row.items() if value} for row in csv.DictReader(lines)]
