"""An experiment as data: one TOML file, every field typed, unknown fields refused."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

from training.recipe import build

EXPERIMENTS = Path(__file__).parent / "experiments"


@dataclass(frozen=True, slots=True)
class Variant:
    """One network of an experiment that trains.

    Attributes:
        name: what tables and files call it.
        settings: of the training recipe, as `training fit --set` takes them.
        methods: of `training.evaluation.registry` to judge it with; WEIGHTS stands for its file.
        label: method of `training label` whose planes it learns from; empty: none.
        steps: instead of the experiment's.
    """

    name: str
    settings: tuple[str, ...] = ()
    methods: tuple[str, ...] = ("raw:WEIGHTS", "paper:WEIGHTS")
    label: str = ""
    steps: int = 0


@dataclass(frozen=True, slots=True)
class Experiment:
    """What `training reproduce` does.

    Attributes:
        title: first line of the result.
        claim: what the paper says, on its own shapes.
        differences: what is not as in the paper.
        minimum: what it takes for the figures to mean something.
        methods: names of `training.evaluation.registry`.
        protocol: ``meshes``, or ``shrec`` for the point clouds of `training.evaluation.shrec`.
        damages: one table each, of `training.evaluation.corruptions.DAMAGES`, or of the perturbations of clouds.
        columns: keys of `training.evaluation.report`, or of the protocol, that the table shows; empty: all that it has.
        chart: the column that the picture draws.
        symmetric: only shapes with a clear plane.
        words: only shapes whose name has one of these; empty: all.
        limit: so many shapes, drawn at random.
        max_error: threshold on the SDE.
        gallery: of so many shapes pictures of what every method returned.
        pictures: which, of `training.reproduction.pictures.GALLERIES`: ``best`` plane with its error as colours, all
            ``planes``, ``axes``, or what is ``completed`` by the first plane, with its error as colours.
        sheet: draw a contact sheet of the ground truth of all shapes that are judged, `truth.png`.
        recipe: the training recipe of the variants.
        start: weights that they begin with; empty: random ones.
        steps: of their training.
        train_share: of the shapes, by the hash of their name, go to training; the rest is judged on.
        variants: networks to train; without any nothing is trained.
    """

    title: str
    claim: str
    differences: str
    minimum: str
    methods: tuple[str, ...] = ()
    protocol: str = "meshes"
    damages: tuple[str, ...] = ("rotated",)
    columns: tuple[str, ...] = ()
    chart: str = "clear_best_mean"
    symmetric: bool = False
    words: tuple[str, ...] = ()
    limit: int = 100
    max_error: float = 4e-4
    gallery: int = 0
    pictures: tuple[str, ...] = ("best",)
    sheet: bool = False
    recipe: str = "default"
    start: str = ""
    steps: int = 600
    train_share: float = 0.8
    variants: tuple[Variant, ...] = ()

    @classmethod
    def load(cls, name: str) -> "Experiment":
        """Load `experiments/NAME.toml`, or a file by its path.

        Raises:
            ValueError: there is no such file, or it does not fit.
        """
        path = Path(name) if name.endswith(".toml") else EXPERIMENTS / f"{name}.toml"
        if not path.is_file():
            raise ValueError(f"there is no experiment {name!r}; known ones are {', '.join(known_experiments())}")
        return build(cls, tomllib.loads(path.read_text(encoding="utf-8")), path.stem)


def known_experiments() -> list[str]:
    """The names that `Experiment.load` knows."""
    return sorted(path.stem for path in EXPERIMENTS.glob("*.toml"))
