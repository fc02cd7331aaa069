"""Classical methods that PRS-Net is measured against, one file each; planes in the unit frame.

Know `model.geometry`, scipy and trimesh; nothing of evaluation or training. A baseline is a module that satisfies
`Baseline`. To add one, write the file and name it in `NAMES`: `evaluate`, `reproduce` and `label` then know it.
"""

from importlib import import_module
from typing import Protocol, cast

import numpy as np

from model.types import FloatArray, IntArray

NAMES = (
    "pca",
    "bounding_box",
    "kazhdan_grid",
    "kazhdan",
    "martinet",
    "mitra",
    "prst",
    "prst_gedt",
    "korman",
    "random_planes",
)
"""The modules of this package, by which commands know them, in the order in which a table lists them."""


class Baseline(Protocol):
    """What a module of this package offers."""

    TITLE: str
    """What a table calls it."""

    def find_planes(self, vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> FloatArray:
        """The reflection planes of a surface.

        Args:
            vertices: ``(v, 3)`` float64, unit frame.
            faces: ``(f, 3)`` int32.
            rng: what the method draws at random follows from it alone.

        Returns:
            ``(k, 4)`` rows ``(n, d)``, unit frame, in the method's own order, the best first; there may be none.
        """
        ...


def load(name: str) -> Baseline:
    """The baseline of a name in `NAMES`.

    Raises:
        ValueError: there is none of this name.
    """
    if name not in NAMES:
        raise ValueError(f"there is no baseline {name!r}; known are {', '.join(NAMES)}")
    return cast(Baseline, import_module(f"{__name__}.{name}"))
