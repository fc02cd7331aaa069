"""What is evaluated: one interface for networks, detectors and classical methods."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

from model.meshes.mesh import Mesh
from training.evaluation.matching import Found


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What a method returned for a mesh, in the mesh's own coordinates.

    Only detectors fill ``stages`` in wall-clock milliseconds, the ``point_group``, and which elements, planes first,
    are called ``exact``. ``confidence``: of each plane, where the method tells one. ``reused_ms``: CPU milliseconds of
    a part that was taken over from an earlier call.
    """

    found: Found
    stages: dict[str, float] = field(default_factory=dict[str, float])
    point_group: str | None = None
    exact: list[bool] | None = None
    confidence: list[float] | None = None
    reused_ms: float = 0.0


class Method(Protocol):
    """Anything that finds symmetries. One that is constructed has loaded and compiled all it needs."""

    @property
    def title(self) -> str:
        """What a table calls it."""
        ...

    def __call__(self, mesh: Mesh, seed: Sequence[int]) -> Answer:
        """The symmetries of a mesh; what is drawn at random follows from ``seed`` alone."""
        ...
