"""Which of two hypotheses explains a surface better, sample by sample."""

import numpy as np

from model.search.settings import DEFAULT, SearchSettings
from model.types import BoolArray, FloatArray


def mean_where(values: FloatArray, there: BoolArray) -> FloatArray:
    """The mean of values ``(k, n)`` over those k that are ``there`` ``(k, n)``: ``(n,)``, 0 of none."""
    return np.where(there, values, 0.0).sum(0) / np.maximum(there.sum(0), 1)


def explains_better(
    squared: FloatArray,
    others: FloatArray,
    settings: SearchSettings = DEFAULT,
    *,
    closely: bool = False,
    likely: bool = False,
) -> bool:
    """Whether one hypothesis explains a surface distinctly better than another one.

    Args:
        squared: ``(n,)`` squared deviations of the first at n samples.
        others: ``(n,)`` those of the other at the same samples.
        settings: ``significance`` and ``advantage``.
        closely: the samples are many: where noise is most of both, a small part of them is all there is.
        likely: it is before one looks: less proof is asked of many samples.
    """
    enough, significance = settings.advantage, settings.significance
    if closely:
        enough = settings.advantage_in_noise
        significance = settings.significance_if_likely if likely else settings.significance_in_noise
    better = float(others.mean()) > enough * float(squared.mean())
    return better and _is_larger(others, squared, significance)


def might_explain_better(
    squared: FloatArray, others: FloatArray, settings: SearchSettings = DEFAULT, *, likely: bool = False
) -> bool:
    """Whether more samples may show that `explains_better` holds: on these it is better, be it by chance."""
    return _is_larger(others, squared, settings.chance_if_likely if likely else settings.chance)


def _is_larger(values: FloatArray, others: FloatArray, significance: float) -> bool:
    """Whether values ``(n,)`` are larger than others ``(n,)`` on average, by so many standard errors."""
    difference = values - others
    spread = float(difference.std()) / np.sqrt(len(difference))
    return float(difference.mean()) > significance * spread
