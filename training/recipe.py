"""A training run as data: one TOML file, every field typed, unknown fields refused."""

import dataclasses
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar, get_type_hints

from model.network.architecture import Architecture

RECIPES = Path(__file__).parent / "recipes"


@dataclass(frozen=True, slots=True)
class InputRecipe:
    """How a shape is rotated before it is voxelized.

    ``frame``: ``unit`` draws a uniform rotation for every sample (the paper's augmentation, on the fly);
    ``inertia`` rotates the input to the eigenvectors of its surface covariance, signs at random. On top of
    ``inertia`` comes a small rotation: with probability ``jitter_shares[i]`` normal with ``jitters[i]`` radians a
    component. Where two eigenvalues lie closer than ``tie`` (relative to the largest) their eigenvectors are
    arbitrary, so the angle between them is drawn accordingly wider, up to uniform.
    """

    frame: Literal["unit", "inertia"] = "unit"
    jitters: tuple[float, ...] = (0.06, 0.35)
    jitter_shares: tuple[float, ...] = (0.75, 0.25)
    tie: float = 0.02


@dataclass(frozen=True, slots=True)
class DamageRecipe:
    """Damage done to the input; the loss is computed on the whole shape (paper, section 6.6).

    ``share`` of the shapes lose the triangles in a ball, its ``radius`` (from, to) a share of the unit frame's edge.
    ``cuts`` of the shapes lose what lies beyond a random plane: a missing bottom, a scan from one side. Neither takes
    more than 1 - ``least`` of the surface. ``scans`` of the shapes are seen by one, two or three depth images alone,
    from random sides, as ``scan_shares`` say (needs `training views`). Of ``sparse`` of them more and more triangles
    are missing along a random direction: uneven density. ``noise`` of the shapes get uniform noise on every vertex, its
    standard deviation (unit frame) drawn up to ``noise_size``. ``clusters`` of them are decimated: vertices in one cell
    of a random grid, its edge drawn up to ``cluster_size``, become one. Of ``doubled`` of them the part beyond a random
    plane is there twice.
    ``spikes`` of them get a needle of a length drawn up to ``spike_length`` on a random triangle, ``outliers`` of them
    up to ten specks anywhere about them.
    """

    share: float = 0.0
    radius: tuple[float, float] = (0.1, 0.3)
    cuts: float = 0.0
    least: float = 0.5
    scans: float = 0.0
    scan_shares: tuple[float, ...] = (0.5, 0.25, 0.25)
    sparse: float = 0.0
    noise: float = 0.0
    noise_size: float = 0.01
    clusters: float = 0.0
    cluster_size: float = 0.06
    doubled: float = 0.0
    spikes: float = 0.0
    spike_length: float = 0.4
    outliers: float = 0.0


@dataclass(frozen=True, slots=True)
class LossRecipe:
    """Section 4. ``samples`` is N, ``regularization`` w_r; the rest departs from the paper where it is not zero.

    ``grid``: resolution of the closest-point grid. ``squared``: distances squared, as the authors' code has it and
    the thresholds assume. ``mask_occupied``: points that fall into an occupied voxel count zero, also from the authors'
    code. ``best_head`` adds this many times three times the smallest of the plane errors.
    """

    samples: int = 1000
    grid: int = 32
    regularization: float = 25.0
    squared: bool = True
    mask_occupied: bool = False
    best_head: float = 0.0


@dataclass(frozen=True, slots=True)
class SupervisionRecipe:
    """Planes of a classical method as an example (paper, "Network Pre-training"); needs `training label`.

    ``weight`` times the distance to the known planes is added to the loss: until the step ``until_step``, or all along
    where that is 0. ``heads`` weighs how far every head is from its nearest known plane, beside how far every known
    plane is from its nearest head. Known planes with an error above ``max_error`` do not count.
    """

    weight: float = 0.0
    until_step: int = 0
    heads: float = 1.0
    max_error: float = 4e-4
    plain: bool = False
    """The distance of two planes itself instead of its square."""

    def weight_at(self, step: int) -> float:
        """The weight that holds in a step."""
        return self.weight if self.until_step == 0 or step < self.until_step else 0.0


@dataclass(frozen=True, slots=True)
class SamplingRecipe:
    """Which shapes are drawn how often.

    ``balance`` over ``source`` or ``category`` gives a group of n shapes a share that grows with n to the power of
    1 - ``power``: 1 makes all groups equal, 0 leaves them as they are. ``per_category`` above zero makes an epoch of so
    many draws of every group, each with its own augmentation (paper, section 6.1: 4,000), all equal. ``shards`` above
    zero goes through an epoch so many shards of the prepared set at a time, in random order, so that no more of it need
    be at hand; 0 draws from all of them all the time.
    """

    balance: Literal["none", "source", "category"] = "none"
    power: float = 1.0
    per_category: int = 0
    shards: int = 0

    def __post_init__(self) -> None:
        if not 0.0 <= self.power <= 1.0 or self.per_category < 0:
            raise ValueError("sampling.power lies between 0 and 1, and sampling.per_category is not negative")
        if self.shards < 0:
            raise ValueError("sampling.shards is not negative")
        if self.per_category and self.balance == "none":
            raise ValueError("sampling.per_category needs sampling.balance to say what a category is")


@dataclass(frozen=True, slots=True)
class OptimizerRecipe:
    """Adam. ``one-cycle`` warms up linearly over the share ``warmup`` of the run, then follows a cosine to zero."""

    steps: int = 20_000
    batch: int = 32
    learning_rate: float = 0.01
    schedule: Literal["constant", "one-cycle"] = "constant"
    warmup: float = 0.1
    clip_norm: float = 0.0
    """Gradients are clipped to this norm; 0 leaves them alone."""


@dataclass(frozen=True, slots=True)
class InferenceRecipe:
    """What the detector does with these weights; copied into the shipped metadata."""

    passes: int = 1
    """Forward passes: after each one the input is rotated into the predicted frame."""
    sign_frames: int = 1
    """Mirror images of each view, up to 8, that are fed in one batch; every output is a candidate (decision 0008)."""
    views: int = 1
    """1: the input frame alone; 3: two further rotations of it as well (`model.network.views`)."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """One run: what `training fit` needs beside data and a device."""

    name: str
    seed: int = 0
    validation_share: float = 0.05
    network: Architecture = field(default_factory=Architecture)
    input: InputRecipe = field(default_factory=InputRecipe)
    damage: DamageRecipe = field(default_factory=DamageRecipe)
    loss: LossRecipe = field(default_factory=LossRecipe)
    supervision: SupervisionRecipe = field(default_factory=SupervisionRecipe)
    sampling: SamplingRecipe = field(default_factory=SamplingRecipe)
    optimizer: OptimizerRecipe = field(default_factory=OptimizerRecipe)
    inference: InferenceRecipe = field(default_factory=InferenceRecipe)

    def to_dict(self) -> dict[str, Any]:
        """Plain nested values, for metadata and for comparing a run with its recipe on resume."""
        return dataclasses.asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> "Recipe":
        """Build from nested values; raises ValueError on an unknown or ill-typed field."""
        return build(cls, values, "recipe")

    @classmethod
    def load(cls, name_or_path: str | Path) -> "Recipe":
        """Load ``NAME`` from `training/recipes/NAME.toml`, or a file by its path."""
        path = Path(name_or_path)
        if path.suffix != ".toml":
            path = RECIPES / f"{name_or_path}.toml"
        if not path.is_file():
            known = ", ".join(sorted(p.stem for p in RECIPES.glob("*.toml")))
            raise ValueError(f"there is no recipe {str(name_or_path)!r}; known ones are {known}")
        return cls.from_dict(tomllib.loads(path.read_text()))

    def with_settings(self, settings: Sequence[str]) -> "Recipe":
        """A copy with fields set as in ``["loss.regularization=25.0", "seed=2"]``, values written as in TOML.

        Raises:
            ValueError: a setting cannot be read, or there is no such field.
        """
        values = self.to_dict()
        for setting in settings:
            key, equals, value = setting.partition("=")
            *sections, name = key.strip().split(".")
            try:
                parsed = tomllib.loads(f"value = {value}")["value"]
            except tomllib.TOMLDecodeError as error:
                raise ValueError(f"{setting!r} is not SECTION.FIELD=VALUE with a value as in TOML") from error
            place = values
            for section in sections:
                place = place.get(section)
                if not isinstance(place, dict):
                    raise ValueError(f"a recipe has no section {section!r}")
            if not equals or name not in place or isinstance(place[name], dict):
                raise ValueError(f"a recipe has no field {key.strip()!r}")
            place[name] = parsed
        return Recipe.from_dict(values)

    def replace(self, **sections: Any) -> "Recipe":
        """A copy with fields replaced; sections take dictionaries, as in ``replace(optimizer={"steps": 10})``."""
        values = self.to_dict()
        for key, change in sections.items():
            values[key] = {**values[key], **change} if isinstance(values.get(key), dict) else change
        return Recipe.from_dict(values)


_T = TypeVar("_T")


def build(kind: type[_T], values: dict[str, Any], where: str) -> _T:
    """A dataclass from plain nested values, as TOML holds them.

    Args:
        kind: the dataclass; its fields may be dataclasses and tuples of them.
        values: by field.
        where: what an error calls the place.

    Raises:
        ValueError: a field is unknown or of another type.
    """
    hints = get_type_hints(kind)
    unknown = set(values) - set(hints)
    if unknown:
        raise ValueError(f"{where} has no field {', '.join(sorted(unknown))}")
    arguments: dict[str, Any] = {}
    for key, value in values.items():
        hint = hints[key]
        if dataclasses.is_dataclass(hint):
            arguments[key] = build(hint, value, f"{where}.{key}")  # pyright: ignore[reportArgumentType]
        else:
            arguments[key] = _checked(hint, value, f"{where}.{key}")
    return kind(**arguments)


def _checked(hint: Any, value: Any, where: str) -> Any:
    choices = getattr(hint, "__args__", ())
    if getattr(hint, "__origin__", None) is Literal:
        if value not in choices:
            raise ValueError(f"{where} must be one of {', '.join(map(str, choices))}, not {value!r}")
        return value
    if getattr(hint, "__origin__", None) is tuple:
        items = hint.__args__[0]
        if dataclasses.is_dataclass(items):
            return tuple(build(items, item, where) for item in value)  # pyright: ignore[reportArgumentType]
        return tuple(_checked(items, item, where) for item in value)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if not isinstance(value, hint) or (hint is int and isinstance(value, bool)):
        raise ValueError(f"{where} must be {hint.__name__}, not {value!r}")
    return value
