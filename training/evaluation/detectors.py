"""The network's raw output, and paper and full mode of the detector, as methods of an evaluation."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Literal

import numpy as np

from model.detector import Detector, use_one_thread
from model.errors import TooComplexError
from model.geometry.frames import UnitFrame
from model.meshes.mesh import Mesh
from model.network.architecture import Architecture
from model.network.checkpoint import Checkpoint, InputSpec, load_checkpoint
from model.network.network import PRSNet
from model.search.full import Sources
from training.evaluation.matching import Found, FoundAxis
from training.evaluation.method import Answer

UNTRAINED = "untrained"
"""Weights of this name are the paper's network as it is initialised: its planes are those of its input frame."""

SOURCES = tuple(source.name for source in fields(Sources))


@dataclass(frozen=True, slots=True)
class Detection:
    """Paper mode, or full mode with some ``sources`` of its starts."""

    title: str
    detector: Detector
    mode: Literal["full", "paper"]
    max_error: float
    sources: Sources

    def __call__(self, mesh: Mesh, seed: Sequence[int]) -> Answer:
        """`training.evaluation.method.Method`."""
        try:
            found = self.detector.detect(mesh, mode=self.mode, max_error=self.max_error, sources=self.sources)
        except TooComplexError:  # refused: no answer
            return Answer(Found(np.zeros((0, 4))))
        planes = np.array([np.append(plane.normal, plane.offset) for plane in found.planes]).reshape(-1, 4)
        axes = [FoundAxis(axis.direction, axis.point, None if axis.continuous else axis.order) for axis in found.axes]
        exact = [element.exact for element in (*found.planes, *found.axes)]
        sure = [plane.confidence for plane in found.planes if plane.confidence is not None]
        confidence = sure if len(sure) == len(found.planes) else None
        return Answer(Found(planes, axes), dict(found.timings_ms), found.point_group, exact, confidence)


@dataclass(frozen=True, slots=True)
class RawNetwork:
    """What leaves the network, nothing refined and nothing validated; an axis' order is 2π by the predicted angle."""

    title: str
    detector: Detector

    def __call__(self, mesh: Mesh, seed: Sequence[int]) -> Answer:
        """`training.evaluation.method.Method`."""
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
        timings: dict[str, float] = {}
        proposals = self.detector.propose(frame.to_unit(mesh.vertices), mesh.faces, timings)
        planes = np.array([frame.plane_to_input(plane) for plane in proposals.planes]).reshape(-1, 4)
        orders = [max(2, round(2.0 * np.pi / max(angle, 1e-3))) for angle in proposals.angles]
        axes = [FoundAxis(line, frame.center, order) for line, order in zip(proposals.directions, orders, strict=True)]
        return Answer(Found(planes, axes), timings)


def raw_network(weights: str) -> RawNetwork:
    """The raw output of a network."""
    return RawNetwork(f"raw network{_suffix(weights)}", loaded(weights))


def paper_mode(weights: str, max_error: float) -> Detection:
    """One answer of the network and the paper's validation (section 5)."""
    return Detection(f"paper mode{_suffix(weights)}", loaded(weights), "paper", max_error, Sources())


def full_mode(weights: str, max_error: float, sources: Sequence[str] = SOURCES) -> Detection:
    """Full mode, for ablations with some sources of starts only.

    Raises:
        ValueError: there is no such source.
    """
    if not set(sources) <= set(SOURCES):
        raise ValueError(f"sources of starts are {', '.join(SOURCES)}, not {'+'.join(sources)}")
    only = "" if set(sources) == set(SOURCES) else f", starts from {' + '.join(sources)}"
    chosen = Sources(**{name: name in sources for name in SOURCES})
    return Detection(f"full mode{_suffix(weights)}{only}", loaded(weights), "full", max_error, chosen)


def ablation() -> list[tuple[str, ...]]:
    """Every single source of starts, the network with each, all but one, and all."""
    sets: list[tuple[str, ...]] = [(name,) for name in SOURCES]
    sets += [(SOURCES[0], name) for name in SOURCES[1:]]
    sets += [tuple(other for other in SOURCES if other != name) for name in SOURCES]
    sets.append(SOURCES)
    return list(dict.fromkeys(sets))


@lru_cache
def loaded(weights: str = "default") -> Detector:
    """A detector for this process, of one thread and warmed up: loaded once."""
    use_one_thread()
    detector = Detector(_untrained() if weights == UNTRAINED else load_checkpoint(weights))
    detector.warm_up()
    return detector


def _untrained() -> Checkpoint:
    network = PRSNet(Architecture()).eval().requires_grad_(False)
    return Checkpoint.of(network, InputSpec("unit"), {"name": UNTRAINED, "version": "", "sha256": ""})


def _suffix(weights: str) -> str:
    return "" if weights == "default" else f" ({weights})"
