"""Whether a group found on a damaged shape is one of the intact shape."""

import numpy as np

from model.geometry.operations import Operations
from model.geometry.refinement import squared_distances
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.search.hypothesis import Hypothesis
from model.search.tilting import tilted
from model.types import FloatArray, IntArray
from training.oracle.exhaustive import TILT

_SAMPLES, _SEED, _TILTED_STRIDE = 1000, 15485863, 3


class IntactShape:
    """The intact shape, where the damaged one is.

    Args:
        vertices: ``(v, 3)`` of the intact shape, in the unit frame of the damaged one.
        faces: ``(f, 3)``.
        ratio: how many times as large that frame's unit is as that of the intact shape's own unit frame.
    """

    def __init__(self, vertices: FloatArray, faces: IntArray, ratio: float) -> None:
        self._surface, self._ratio = SurfaceIndex(vertices, faces, work=np.inf), ratio
        self._samples, _ = sample_surface(vertices, faces, _SAMPLES, seed=_SEED)

    def judged(self, level: Hypothesis) -> tuple[float, float]:
        """The largest SDE of a group's operations, in the intact shape's own unit frame, and the least contrast of any.

        The contrast of an operation is how many times as large its SDE is at least when it is tilted out of the group,
        as nothing is of a sphere's.
        """
        error = float(self._errors(level.measured_operations, self._samples).max())
        few, contrast = self._samples[::_TILTED_STRIDE], np.inf
        telling = level.telling
        for k in range(0 if level.name == "Kh" else len(telling)):
            own = self._errors(telling[[k]], few)[0]
            contrast = min(
                contrast,
                float(self._errors(tilted(telling[[k]], TILT, level.turning_axis), few).min() / max(own, 1e-12)),
            )
        return error * self._ratio**2, contrast

    def _errors(self, operations: Operations, samples: FloatArray) -> FloatArray:
        return squared_distances(self._surface, samples, operations).mean(1)
