"""Paper mode: the network's own output, nothing refined, validate_proposals exactly as the paper does (section 5)."""

import numpy as np

from model.geometry.surface import SurfaceIndex
from model.network.proposals import Proposals
from model.paper.point_group import TOLERANCE, point_group
from model.paper.validation import Judged, validate_axes, validate_planes
from model.symmetries import Candidate, FoundAxis, FoundPlane, Symmetries
from model.types import FloatArray


def validate_proposals(
    proposals: Proposals, surface: SurfaceIndex, samples: FloatArray, max_error: float
) -> Symmetries:
    """At most three planes and three continuous axes, all through the origin of the unit frame but for their offsets.

    Args:
        proposals: the network's output, unit frame.
        surface: what to measure against.
        samples: ``(n, 3)`` points on it.
        max_error: threshold on the SDE.
    """
    planes = validate_planes(proposals.planes, surface, samples, max_error)
    axes = validate_axes(proposals.directions, proposals.angles, surface, samples, max_error)
    directions = _rows([judged.vector for judged in axes if judged.reason is None])
    normals = _rows([judged.vector[:3] for judged in planes if judged.reason is None])
    result = Symmetries(point_group=point_group(normals, directions))
    for judged in planes:
        if judged.reason is not None:
            result.rejected.append(Candidate(judged.error, judged.reason, plane=judged.vector))
        else:
            through = bool((np.abs(directions @ judged.vector[:3]) < np.sin(TOLERANCE)).any())
            result.planes.append(FoundPlane(judged.vector, judged.error, continuous=through))
    for judged in axes:
        _add_axis(result, judged)
    return result


def _add_axis(result: Symmetries, judged: Judged) -> None:
    origin = np.zeros(3)
    if judged.reason is None:
        result.axes.append(FoundAxis(judged.vector, origin, None, judged.error))
    else:
        result.rejected.append(Candidate(judged.error, judged.reason, direction=judged.vector, point=origin))


def _rows(vectors: list[FloatArray]) -> FloatArray:
    return np.stack(vectors) if vectors else np.zeros((0, 3))
