"""The methods that can be evaluated, by name.

- ``full``, ``paper``, ``raw``: the detector's two modes and the network's raw output; with other weights than the
  shipped ones ``raw:FILE.safetensors``, ``raw:paper``, ``raw:untrained``. ``full[network+scan]`` starts full mode from
  these sources only; ``ablation`` stands for all sets of sources that weigh them.
- every baseline of `training.baselines.NAMES`; ``exhaustive``, the search that makes the ground truth.
- ``+refined`` and ``+validated`` behind a name: its planes with our refinement, or after the paper's validation.
"""

import hashlib
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path

from model.detector import use_one_thread
from model.meshes.mesh import Mesh
from training import baselines
from training.evaluation.classical import Classical, Exhaustive, Refined, Reused, Validated
from training.evaluation.detectors import SOURCES, ablation, full_mode, paper_mode, raw_network
from training.evaluation.method import Method
from training.shapes.solids import box
from training.trainer.revision import git_revision

DEFAULT_METHODS = ("full", "paper", "raw", "pca", "pca+refined", "bounding_box")

_FACTORIES: dict[str, Callable[[str, float], Method]] = {
    "full": full_mode,
    "paper": paper_mode,
    "raw": lambda weights, max_error: raw_network(weights),
}
"""Methods that take weights: from these and the threshold on the SDE."""

_STEPS: dict[str, Callable[[Method, float], Method]] = {"refined": Refined, "validated": Validated}


def expand(names: Sequence[str]) -> tuple[str, ...]:
    """The names without doubles, ``ablation`` spelled out.

    Raises:
        ValueError: a name is none of a method.
    """
    spelled: list[str] = []
    for name in names:
        spelled += [f"full[{'+'.join(chosen)}]" for chosen in ablation()] if name == "ablation" else [name]
    for name in spelled:
        _parse(name)
    return tuple(dict.fromkeys(spelled))


def method_record(name: str) -> dict[str, str]:
    """What a record says of a method's answers: the ``revision`` of the code, and a hash of ``weights`` from a file."""
    weights = Path(_parse(name)[1])
    record = {"revision": git_revision()}
    if weights.suffix == ".safetensors":
        record["weights"] = hashlib.sha256(weights.read_bytes()).hexdigest()
    return record


def build(name: str, max_error: float) -> Method:
    """The method of a name, loaded and compiled.

    Args:
        name: see this module.
        max_error: threshold on the SDE, for methods that have one.

    Raises:
        ValueError: there is no such method.
    """
    base, argument, steps = _parse(name)
    method: Method = _base(base, argument, max_error)
    for step in steps:
        method = _STEPS[step](method, max_error)
    vertices, faces = box((1.0, 2.0, 3.0))
    method(Mesh.checked(vertices, faces), (0,))
    return method


@lru_cache(maxsize=1)
def build_all(names: tuple[str, ...], max_error: float) -> dict[str, Method]:
    """The methods of all names, once a process; see `expand` and `build`."""
    use_one_thread()
    return {name: build(name, max_error) for name in expand(names)}


@lru_cache(maxsize=64)
def _base(base: str, argument: str, max_error: float) -> Reused:
    """One object for a method and for what is done with its planes: it need not run twice."""
    if base in _FACTORIES and argument.startswith("["):
        return Reused(full_mode("default", max_error, argument[1:-1].split("+")))
    if base in _FACTORIES:
        return Reused(_FACTORIES[base](argument or "default", max_error))
    return Reused(Exhaustive(max_error) if base == "exhaustive" else Classical(baselines.load(base)))


def _parse(name: str) -> tuple[str, str, list[str]]:
    """Base, its argument (weights, or sources in brackets) and the steps behind it."""
    if name.startswith("full[") and name.endswith("]"):
        if not set(name[5:-1].split("+")) <= set(SOURCES):
            raise ValueError(f"there is no method {name!r}: sources of starts are {', '.join(SOURCES)}")
        return "full", name[4:], []
    words = name.split("+")
    steps: list[str] = []
    while words and words[-1] in _STEPS:
        steps.insert(0, words.pop())
    base, colon, weights = "+".join(words).partition(":")
    known = (*_FACTORIES, *baselines.NAMES, "exhaustive")
    if base not in known or (colon and base not in _FACTORIES):
        raise ValueError(
            f"there is no method {name!r}; known are {', '.join(known)}, with :WEIGHTS behind {', '.join(_FACTORIES)}, "
            f"and +{' or +'.join(_STEPS)} behind any"
        )
    return base, weights, steps
