"""How sure a level of the answer is: the probability that its group is one of the intact shape.

A symmetry of an imperfect shape is a guess at what was meant. How often such guesses are right was counted on shapes of
the training split, damaged on purpose, whose truth is known; what tells right from wrong is weighed by a logistic
regression (`python -m training calibrate`), whose coefficients stand in ``confidence.json``.
"""

import json
from dataclasses import astuple, dataclass, fields
from functools import lru_cache
from importlib.resources import files
from typing import Any

import numpy as np

from model.geometry._boundary_kernels import BEHIND
from model.network.output import NetworkOutput
from model.search.context import SearchContext
from model.search.hypothesis import Hypothesis
from model.search.tilting import tilted
from model.symmetries import EvidenceKind
from model.types import FloatArray

_MOST_OPERATIONS, _STRIDE, _BESIDE_STRIDE = 3, 2, 4
_FARTHEST = float(np.deg2rad(45.0))
_SHARPEST, _LARGEST, _FARTHEST_OFF = 3.0, 6.0, 1.5
_STRAIGHT = 0.003
"""Rims of which no larger a share zigzags are as somebody drew them."""

_ROUNDING = -3.0
"""Logarithm of the RMS deviation that rounding of coordinates leaves, as a part of the threshold: less is chance, and
says no more."""

_ROUNDED = 10.0**_ROUNDING


@dataclass(frozen=True, slots=True)
class Evidence:
    """What speaks for a group and against it, in numbers near to 1.

    ``deviation``, ``median``: logarithms (base 10) of the RMS and median deviation as parts of the threshold,
    rounding aside. ``missing``: share of the surface whose counterpart was not seen, the mean over the operations;
    ``unsupported``: that no operation found. ``uncovered``: share whose counterpart is not there within the
    distance that fits; ``contradicting``: share that is taken off a surface that is there. ``sharpness``: logarithm
    of how many times worse at least, squared, the operations are when tilted; ``excused``: share of the surface whose
    counterpart was not seen then, which is large where open edges are everywhere and excuse anything. ``size``:
    logarithm (base 2) of the number of members. ``network``: largest angle between an element measured and the
    nearest proposal of the network, as a part of 45 degrees; NaN if it was not asked. ``one_sided``: length of the
    mean normal of an open surface. ``ragged``: logarithm of the share of its rims that zigzags, as where something
    was torn off. ``as_is``: like ``deviation``, as if nothing were missing, which decides where nothing is. ``behind``:
    share of the surface whose counterpart was not seen because it lies behind the near side of what is there, not
    beyond an edge. ``noise``: like ``deviation``, what of it is noise. ``open``: 1 if there are open edges, else 0:
    with the products of the others it makes two regressions of one.
    """

    deviation: float
    median: float
    missing: float
    unsupported: float
    uncovered: float
    contradicting: float
    sharpness: float
    excused: float
    size: float
    network: float
    one_sided: float
    ragged: float
    as_is: float
    behind: float
    noise: float
    open: float


NAMES = tuple(field.name for field in fields(Evidence))


def evidence(context: SearchContext, level: Hypothesis, network: NetworkOutput | None) -> Evidence:
    """Measure what speaks for a group where it is placed.

    Args:
        context: the shape.
        level: the group.
        network: what the network says, None if it is not to be asked.
    """
    settings, limit = context.settings, context.limit
    operations = level.telling[:_MOST_OPERATIONS]
    samples = context.judging.every(_STRIDE)
    found = context.meter.measure(operations, samples)
    there = found.squared[~found.missing]
    cut = max(settings.truncation, 1.5 * limit) ** 2
    few = context.judging.every(_BESIDE_STRIDE)
    own = np.minimum(found.squared, cut).mean(1)
    beside, excused = np.full(len(operations), np.inf), np.empty(len(operations))
    for k in range(len(operations)):
        aside = context.meter.measure(tilted(operations[[k]], settings.tilt, level.turning_axis), few)
        if level.name != "Kh":  # what is tilted of a sphere is as good
            beside[k] = np.minimum(aside.squared, cut).mean(1).min()
        excused[k] = aside.missing_share.mean()
    rounding = settings.file_precision**2
    sharpness = np.log10(np.maximum(beside, rounding) / np.maximum(own, rounding)).min()
    return Evidence(
        deviation=_logarithm(level.rms / limit, _ROUNDED),
        median=_logarithm(float(np.sqrt(np.median(there))) / limit if len(there) else 1.0, _ROUNDED),
        missing=float(found.missing_share.mean()),
        unsupported=float(found.missing.all(0).mean()),
        uncovered=1.0 - float(found.coverage(settings.fit_distance).min()),
        contradicting=float(found.contradicting(settings.fit_distance).max()),
        sharpness=min(float(sharpness), _SHARPEST),
        excused=float(excused.mean()),
        size=min(float(np.log2(max(level.group.size, 1.0))), _LARGEST),
        network=_from_network(level, network),
        one_sided=context.meter.one_sidedness,
        ragged=_logarithm(context.meter.raggedness, _STRAIGHT),
        as_is=min(_logarithm(level.as_is / limit, _ROUNDED), _FARTHEST_OFF),
        behind=float((found.unseen == BEHIND).mean()),
        noise=_logarithm(float(context.meter.noise(operations, samples).max()) / limit, _ROUNDED),
        open=float(not context.meter.closed),
    )


def confidence(context: SearchContext, level: Hypothesis, network: NetworkOutput | None) -> float:
    """The probability, from 0 to 1, that a group is one of the intact shape.

    Args:
        context: the shape.
        level: the group, measured where it is placed.
        network: what the network says, None if it is not to be asked.
    """
    if is_certain(context, level):
        return 1.0  # what `predict` says, without looking for evidence
    known = learned("measured", NAMES)
    row = np.array(astuple(evidence(context, level, network)))
    # Without the network: as if it had said what it usually does.
    return float(predict(known.coefficients, np.where(np.isnan(row), known.means, row)[None])[0])


def is_certain(context: SearchContext, level: Hypothesis) -> bool:
    """Whether a level holds everywhere on the surface as it is, to rounding: no evidence is looked for."""
    return level.coverage == 1.0 and _logarithm(level.rms / context.limit, _ROUNDED) <= _ROUNDING


def predict(coefficients: FloatArray, rows: FloatArray) -> FloatArray:
    """Probabilities ``(n,)`` of evidence ``(n, e)`` by `terms` and their coefficients ``(t,)``.

    What holds everywhere on the surface as it is, to rounding, is no guess: 1.
    """
    deviation, uncovered = rows[:, NAMES.index("deviation")], rows[:, NAMES.index("uncovered")]
    holds = (deviation <= _ROUNDING) & (uncovered == 0.0)
    return np.where(holds, 1.0, logistic(terms(rows) @ coefficients))


def logistic(log_odds: FloatArray) -> FloatArray:
    """Probabilities of their log-odds."""
    return 1.0 / (1.0 + np.exp(-log_odds))


def terms(rows: FloatArray) -> FloatArray:
    """What the regression weighs: 1, the evidence ``(n, e)``, its squares and products: ``(n, t)``."""
    first, second = np.triu_indices(rows.shape[1])
    return np.column_stack([np.ones(len(rows)), rows, rows[:, first] * rows[:, second]])


@dataclass(frozen=True, slots=True, eq=False)
class Learned:
    """What `python -m training calibrate` found: ``coefficients`` ``(t,)`` of terms, ``means`` ``(e,)`` of evidence."""

    coefficients: FloatArray
    means: FloatArray


@lru_cache(maxsize=2)
def learned(kind: EvidenceKind, names: tuple[str, ...]) -> Learned:
    """What ``confidence.json`` holds for one kind of level, read once.

    Args:
        kind: of the level.
        names: of the evidence that it is to be for.

    Raises:
        ValueError: it was made for other evidence.
    """
    record: dict[str, Any] = json.loads(files("model.search").joinpath("confidence.json").read_text(encoding="utf-8"))
    if kind not in record or record[kind]["evidence"] != list(names):
        raise ValueError("confidence.json was made for other evidence: run `python -m training calibrate`")
    return Learned(np.array(record[kind]["coefficients"]), np.array(record[kind]["means"]))


def _logarithm(part: float, least: float) -> float:
    return float(np.log10(max(part, least)))


def _from_network(level: Hypothesis, network: NetworkOutput | None) -> float:
    """How far the network's nearest proposals are from the elements measured, at most 1; NaN if it was not asked."""
    if network is None:
        return np.nan
    proposals = network.first
    operations = level.generators[:_MOST_OPERATIONS]
    farthest = 0.0
    for k in range(len(operations)):
        mirror = bool(operations.improper[k]) and operations.angles[k] < 1e-6
        lines = proposals.planes[:, :3] if mirror else proposals.directions
        if operations.improper[k] and not mirror:
            continue
        cosine = float(np.abs(lines @ operations.directions[k]).max(initial=0.0))
        farthest = max(farthest, float(np.arccos(min(cosine, 1.0))))
    return min(farthest / _FARTHEST, 1.0)
