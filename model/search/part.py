"""Whether a part of a shape alone may have more symmetries than the whole."""

import numpy as np

from model.geometry.operations import Operations
from model.geometry.refinement import squared_distances
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.search.point_groups import ARBITRARY_ANGLES
from model.symmetries import Symmetries
from model.types import FloatArray, IntArray

_SAMPLES, _SEED = 200, 3
_BETTER = 0.5
"""A part has a symmetry better than the whole if it deviates by less than this part of what the whole does."""


def fits_better(found: Symmetries, vertices: FloatArray, faces: IntArray, max_error: float) -> bool:
    """Whether any plane or axis that the whole has, or might have had, holds of a part, and distinctly better.

    That is much cheaper to see than the part is to search.

    Args:
        found: of the whole, with the candidates it left over.
        vertices: ``(v, 3)``, unit frame of the whole.
        faces: ``(f, 3)`` of the part.
        max_error: largest SDE of a symmetry.
    """
    planes = [(item.plane, item.error) for item in found.planes]
    axes = [(item.direction, item.point, item.order, item.error) for item in found.axes]
    for item in (*found.similar, *found.rejected):
        if item.plane is not None:
            planes.append((item.plane, item.error))
        elif item.direction is not None and item.point is not None:
            axes.append((item.direction, item.point, 2, item.error))
    operations = Operations.joined(
        [
            Operations.reflections(np.array([plane for plane, _ in planes])),
            *(
                Operations.rotations(direction, point, 2.0 * np.pi / order if order else ARBITRARY_ANGLES[:1])
                for direction, point, order, _ in axes
            ),
        ]
    )
    if not len(operations):
        return False
    errors = np.array([*(error for _, error in planes), *(error for *_, error in axes)])
    samples, _ = sample_surface(vertices, faces, _SAMPLES, _SEED)
    own = squared_distances(SurfaceIndex(vertices, faces), samples, operations).mean(1)
    return bool(((own <= max_error) & (own < _BETTER**2 * errors)).any())
