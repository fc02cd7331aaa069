"""The networks of an experiment: prepared, labelled, trained and exported, each step resumed where it stopped."""

import csv
import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path

from model.network.checkpoint import load_checkpoint
from training.data.labels import Options as LabelOptions
from training.data.labels import label
from training.data.prepare import Options, prepare
from training.data.prepared import PreparedSet
from training.layouts import find_meshes
from training.recipe import Recipe
from training.reproduction.experiment import Experiment, Variant
from training.trainer.export import export_run
from training.trainer.fit import Initialization, fit


def judged_on(name: str, train_share: float) -> bool:
    """Whether a shape is one that networks are judged on, decided by the hash of its name alone."""
    digest = hashlib.sha256(name.encode()).digest()
    return int.from_bytes(digest[:8], "big") / 2**64 >= train_share


def train_networks(
    experiment: Experiment,
    folders: Sequence[Path],
    out: Path,
    *,
    steps: int | None = None,
    limit: int | None = None,
    workers: int = 1,
    progress: bool = True,
    tell: Callable[[str], None] = lambda line: None,
) -> dict[str, tuple[Variant, Path]]:
    """Train every variant on the shapes below ``folders`` that none is judged on.

    Args:
        experiment: with variants.
        folders: of meshes.
        out: holds the prepared set and the runs; what is there already is not made again.
        steps: instead of the experiment's.
        limit: train on so many shapes at most.
        workers: processes of preparation and labelling.
        progress: show bars.
        tell: called with a line about every step.

    Returns:
        the variants by name, with the weights of each.
    """
    out.mkdir(parents=True, exist_ok=True)
    manifest = out / "split.csv"
    names = [source.name for source in find_meshes(folders)]
    train = [name for name in names if not judged_on(name, experiment.train_share)]
    chosen = set(sorted(train, key=lambda name: hashlib.sha256(b"draw" + name.encode()).digest())[:limit])
    with manifest.open("w", newline="", encoding="utf-8") as lines:
        writer = csv.writer(lines)
        writer.writerow(["path", "split"])
        writer.writerows([name, "train" if name in chosen else "other"] for name in names)
    trained: dict[str, tuple[Variant, Path]] = {}
    for variant in experiment.variants:
        recipe = Recipe.load(experiment.recipe).with_settings(variant.settings)
        recipe = recipe.replace(name=variant.name, optimizer={"steps": steps or variant.steps or experiment.steps})
        resolution = recipe.network.resolution
        prepared = out / f"prepared-{resolution}"
        tell(f"{variant.name}: preparing {len(chosen)} shapes")
        prepare(folders, prepared, Options(resolution), workers, progress, split="train", manifest=manifest)
        data = PreparedSet(prepared)
        if variant.label:
            tell(f"{variant.name}: labels of {variant.label}")
            label(data, LabelOptions(variant.label), None, workers, progress)
        run, weights = out / "runs" / variant.name, out / f"{variant.name}.safetensors"
        tell(f"{variant.name}: {recipe.optimizer.steps} steps")
        start = None
        if experiment.start:
            given = load_checkpoint(experiment.start)
            start = Initialization(given.network, {key: given.metadata[key] for key in ("name", "version", "sha256")})
        every = max(1, recipe.optimizer.steps // 10)
        fit(recipe, PreparedSet(prepared), run, start=start, log_every=every, validate_every=every)
        export_run(run, weights, name=variant.name)
        trained[variant.name] = (variant, weights)
    return trained
