"""What the network is measured against: planes from classical methods, in the unit frame."""

import numpy as np
from trimesh.bounds import oriented_bounds

from model.geometry.frames import inertia_frame
from model.network.checkpoint import Checkpoint, InputSpec
from model.network.network import Architecture, PRSNet
from model.types import FloatArray, IntArray

_FLAT = 1e-10


def pca_planes(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """PCA: the three planes through the centroid perpendicular to the principal axes of the surface.

    The covariance is the exact integral over the triangles. ``vertices`` ``(v, 3)`` in the unit frame; returns
    ``(3, 4)`` rows ``(n, 0)``.
    """
    return np.hstack([inertia_frame(vertices, faces)[0], np.zeros((3, 1))])


def box_planes(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Oriented bounding box (paper, section 6.2): the three mid-planes of the box of least volume.

    ``vertices`` ``(v, 3)`` in the unit frame; returns ``(3, 4)`` rows ``(n, d)``. The box comes from trimesh: one side
    of it lies on a face of the convex hull. A flat shape has no hull and gets the box along its principal axes.
    """
    points = vertices[np.unique(faces)]
    principal, values = inertia_frame(vertices, faces)
    if values[2] > _FLAT * values[0]:
        return np.ascontiguousarray(oriented_bounds(points)[0][:3])
    turned = points @ principal.T
    return np.column_stack([principal, -(turned.max(0) + turned.min(0)) / 2.0])


def untrained(spec: InputSpec) -> Checkpoint:
    """The paper's network before training, fed as ``spec`` says: what the initialisation alone is worth.

    Its planes are the coordinate planes of the frame it is fed with; in the inertia frame that is PCA.
    """
    network = PRSNet(Architecture()).eval().requires_grad_(False)
    return Checkpoint(network, spec, {"name": "untrained", "version": "", "sha256": ""})
