"""A plane that only the network sees: what half a chair usually looks like, where the half that is there cannot tell.

Where no measured level is believed, of an open surface, the network is asked what it sees from several views. Its
answers are votes: planes near each other are one guess, the nearer to the voxels the better. Each guess is fitted to
what surface can be compared, and the probability that it is a symmetry of the intact shape is learned as that of a
measured level is (`model.search.confidence`), from guesses about shapes whose intact form is known. It is the answer
if it is at least as sure as a measured one must be, and says so: ``predicted``. It is never exact.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np

from model.geometry.operations import Operations
from model.network.output import NetworkOutput
from model.search import confidence
from model.search.confidence import Evidence, learned, logistic
from model.search.context import SearchContext
from model.search.hypothesis import Hypothesis
from model.search.point_groups import frame_of, point_group
from model.types import FloatArray

NAMES = ("measured", "votes", "voxels")
"""The evidence for a guess: log-odds of a measured level of which the same were seen; share of the network's answers
that are votes for it, a head having one in each view and frame; natural logarithm of the squared distance, in voxels,
by which the best vote misses the voxels."""

_SAME_GUESS = float(np.cos(np.deg2rad(10.0)))
_MOST_GUESSES = 6
_SUREST = 7.0
"""Log-odds count up to here, either way: one in a thousand."""


@dataclass(frozen=True, slots=True, eq=False)
class Guess:
    """A plane as a group ``Cs``, fitted, what was ``seen`` there, and its ``votes`` and ``voxels``: see `NAMES`."""

    level: Hypothesis
    seen: Evidence
    votes: float
    voxels: float

    @property
    def row(self) -> tuple[float, ...]:
        """All of it as numbers, for `weighed`."""
        return (*astuple(self.seen), self.votes, self.voxels)


def guesses(context: SearchContext, network: NetworkOutput) -> list[Guess]:
    """The planes that the network thinks of, each once, at most a few; none that the surface rules out.

    Args:
        context: the shape.
        network: what is asked.
    """
    planes = network.every.planes
    votes = Operations.reflections(planes)
    misses = context.interpolated_errors(votes)
    heads = len(network.first.planes)
    left = np.ones(len(planes), dtype=np.bool_)
    found: list[Guess] = []
    for index in np.argsort(misses, kind="stable").tolist():
        if not left[index]:
            continue
        same = left & (np.abs(planes[:, :3] @ planes[index, :3]) > _SAME_GUESS)
        left &= ~same
        level = _fitted(context, votes[[index]])
        if level.coverage > 0.0 and level.rms <= context.limit:
            share = heads * float(same.sum()) / len(planes)
            voxels = float(np.log(max(misses[index], 1e-3)))
            found.append(Guess(level, confidence.evidence(context, level, network), share, voxels))
        if len(found) == _MOST_GUESSES:
            break
    return found


def likeliest(found: Sequence[Guess]) -> tuple[Hypothesis, float] | None:
    """The guess that is most probably a plane of the intact shape, and this probability; None of none.

    Raises:
        ValueError: ``confidence.json`` was made for other evidence.
    """
    if not found:
        return None
    rows = weighed(np.array([guess.row for guess in found]), learned("measured", confidence.NAMES).coefficients)
    sure = predict(learned("predicted", NAMES).coefficients, rows)
    best = int(sure.argmax())
    return found[best].level, float(sure[best])


def weighed(rows: FloatArray, measured: FloatArray) -> FloatArray:
    """The evidence `NAMES` ``(n, 3)`` of guesses' numbers `Guess.row` ``(n, e)``.

    Args:
        rows: of the guesses.
        measured: the coefficients for measured levels.
    """
    log_odds = confidence.terms(rows[:, :-2]) @ measured
    return np.column_stack([np.clip(log_odds, -_SUREST, _SUREST), rows[:, -2:]])


def predict(coefficients: FloatArray, rows: FloatArray) -> FloatArray:
    """Probabilities ``(n,)`` of evidence ``(n, 3)`` by `terms` and their coefficients ``(4,)``."""
    return logistic(terms(rows) @ coefficients)


def terms(rows: FloatArray) -> FloatArray:
    """What the regression weighs: 1 and the evidence ``(n, 3)``, no products, for guesses are few: ``(n, 4)``."""
    return np.column_stack([np.ones(len(rows)), rows])


def _fitted(context: SearchContext, vote: Operations) -> Hypothesis:
    """A reflection as a group, where the voxels and then what surface can be compared fit it best nearby."""
    settled = context.settled_on_voxels(vote)
    normal = settled.directions[0]
    guess = Hypothesis(point_group("Cs"), frame_of(normal, normal), settled.points[0])
    return guess.measured(context).fitted(context)
