"""Planes as callers have them."""

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from app.schemas import Plane
from model.types import FloatArray

PlaneLike: TypeAlias = Plane | ArrayLike
"""A plane of an answer, or a normal of any length and an offset: four numbers."""


def plane_numbers(plane: PlaneLike) -> FloatArray:
    """Unit normal and offset ``(4,)``.

    Raises:
        ValueError: it is no plane.
    """
    if isinstance(plane, Plane):
        return np.array([*plane.normal, plane.offset])
    numbers = np.asarray(plane, dtype=np.float64)
    length = float(np.linalg.norm(numbers[:3])) if numbers.shape == (4,) else 0.0
    if not (np.isfinite(numbers).all() and length > 0.0):
        raise ValueError("a plane is a normal and an offset: four numbers")
    return numbers / length
