"""The networks of an experiment: prepared, labelled, trained and exported, each step resumed where it stopped."""

import csv
import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from model.network.checkpoint import load_checkpoint
from training.data.labels import Options as LabelOptions
from training.data.labels import label
from training.data.prepare import Options, prepare
from training.data.prepared import PreparedSet
from training.layouts import find_meshes
from training.recipe import Recipe
from training.reproduction.experiment import Experiment, Variant
from training.trainer.export import export_run
from training.trainer.fit import Initialization, Progress, fit
from training.trainer.monitor import CollapseError


def judged_on(name: str, train_share: float) -> bool:
    """Whether a shape is one that networks are judged on, decided by the hash of its name alone."""
    digest = hashlib.sha256(name.encode()).digest()
    return int.from_bytes(digest[:8], "big") / 2**64 >= train_share


def train_networks(
    experiment: Experiment,
    folders: Sequence[Path],
    out: Path,
    *,
    train_share: float = 1.0,
    prepared: Path | None = None,
    settings: Sequence[str] = (),
    steps: int | None = None,
    limit: int | None = None,
    workers: int = 1,
    progress: bool = True,
    tell: Callable[[str], None] = lambda line: None,
) -> dict[str, tuple[Variant, Path]]:
    """Train every variant on the shapes below ``folders`` that none is judged on.

    A run that collapses ends there: what it was at its best is judged, and a line says so.

    Args:
        experiment: with variants.
        folders: of meshes.
        out: holds the prepared set and the runs; what is there already is not made again.
        train_share: of the shapes, by the hash of their name.
        prepared: folder of the prepared set instead of one in ``out``: several experiments may share it.
        settings: of the training recipe, for every variant, on top of its own.
        steps: instead of the experiment's; the steps of a pre-training shrink or grow with them.
        limit: train on so many shapes at most.
        workers: processes of preparation and labelling.
        progress: show bars.
        tell: called with a line about every step.

    Returns:
        the variants by name, with the weights of each.
    """
    out.mkdir(parents=True, exist_ok=True)
    place = prepared or out / "prepared"
    place.mkdir(parents=True, exist_ok=True)
    manifest = place / "split.csv"
    names = [source.name for source in find_meshes(folders)]
    train = [name for name in names if not judged_on(name, train_share)]
    chosen = set(sorted(train, key=lambda name: hashlib.sha256(b"draw" + name.encode()).digest())[:limit])
    if not chosen:
        raise ValueError(f"of {len(names)} shapes none falls to training; give more of them")
    recipes = {of.name: recipe_of(experiment, of, steps, settings) for of in experiment.variants}
    grids = {recipe.loss.grid for recipe in recipes.values()}
    with manifest.open("w", newline="", encoding="utf-8") as lines:
        writer = csv.writer(lines)
        writer.writerow(["path", "split"])
        writer.writerows([name, "train" if name in chosen else "other"] for name in names)
    tell(f"preparing {len(chosen)} shapes in {place}")
    prepare(folders, place, Options(min(grids)), workers, progress, split="train", manifest=manifest)
    trained: dict[str, tuple[Variant, Path]] = {}
    for variant in experiment.variants:
        recipe = recipes[variant.name]
        if recipe.supervision.weight > 0:
            tell(f"{variant.name}: labels of {variant.label}")
            label(PreparedSet(place), LabelOptions(variant.label), None, workers, progress)
        run, weights = out / "runs" / variant.name, out / f"{variant.name}.safetensors"
        tell(f"{variant.name}: {recipe.optimizer.steps} steps")
        start = None
        if experiment.start:
            given = load_checkpoint(experiment.start)
            start = Initialization(given.network, {key: given.metadata[key] for key in ("name", "version", "sha256")})
        every = max(1, recipe.optimizer.steps // 10)
        with tqdm(total=recipe.optimizer.steps, unit="step", disable=not progress) as bar:

            def shown(done: Progress, bar: Any = bar) -> None:
                bar.update(done.step - bar.n)
                bar.set_postfix(loss=f"{done.loss:.3f}", samples_per_second=f"{done.samples_per_second:.0f}")

            try:
                fit(
                    recipe,
                    PreparedSet(place),
                    run,
                    start=start,
                    log_every=max(1, every // 5),
                    validate_every=every,
                    on_progress=shown,
                )
            except (CollapseError, FloatingPointError) as error:
                if not (run / "best.pt").is_file():
                    raise ValueError(f"{variant.name} was lost before its first validation: {error}") from error
                tell(f"{variant.name} ended early, its best checkpoint is judged: {error}")
        export_run(run, weights, name=variant.name)
        trained[variant.name] = (variant, weights)
    return trained


def recipe_of(
    experiment: Experiment, variant: Variant, steps: int | None = None, settings: Sequence[str] = ()
) -> Recipe:
    """The training recipe of a variant; in a shorter or longer run its pre-training takes the same share of it."""
    recipe = Recipe.load(experiment.recipe).with_settings(variant.settings)
    planned = variant.steps or experiment.steps
    recipe = recipe.replace(name=variant.name, optimizer={"steps": steps or planned})
    until = recipe.supervision.until_step
    if steps and until:
        recipe = recipe.replace(supervision={"until_step": max(1, round(until * steps / planned))})
    return recipe.with_settings(settings)
