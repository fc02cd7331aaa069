"""Reflections and rotations as arrays: applied to points, and as 4 x 4 matrices for clients."""

import numpy as np

from model._jit import jit, kernel_array
from model.types import FloatArray


def turned(points: FloatArray, rotation: FloatArray) -> FloatArray:
    """Points ``(n, 3)`` turned by a rotation ``(3, 3)``: many times faster than a product of matrices of this shape."""
    result = np.empty((len(points), 3))
    _turn(kernel_array(points, np.float64), kernel_array(rotation, np.float64), result)
    return result


@jit
def _turn(points: FloatArray, rotation: FloatArray, result: FloatArray) -> None:
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for a in range(3):
            result[i, a] = rotation[a, 0] * x + rotation[a, 1] * y + rotation[a, 2] * z


def reflect(points: FloatArray, plane: FloatArray) -> FloatArray:
    """Reflect points ``(n, 3)`` in a plane ``(n, d)`` ``(4,)`` with unit normal (paper, Eq. 1)."""
    normal = plane[:3]
    return points - 2.0 * (points @ normal + plane[3])[:, None] * normal


def rotation_matrix(direction: FloatArray, angle: float) -> FloatArray:
    """Rotation ``(3, 3)`` about a unit ``direction`` ``(3,)`` through the origin by ``angle`` radians (Rodrigues)."""
    x, y, z = direction
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)


def reflection_homogeneous(plane: FloatArray) -> FloatArray:
    """The reflection in a plane ``(n, d)`` as a ``(4, 4)`` matrix that acts on column vectors."""
    normal = plane[:3]
    matrix = np.eye(4)
    matrix[:3, :3] -= 2.0 * np.outer(normal, normal)
    matrix[:3, 3] = -2.0 * plane[3] * normal
    return matrix


def rotation_homogeneous(direction: FloatArray, point: FloatArray, angle: float) -> FloatArray:
    """The rotation about the axis through ``point`` as a ``(4, 4)`` matrix that acts on column vectors."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_matrix(direction, angle)
    matrix[:3, 3] = point - matrix[:3, :3] @ point
    return matrix


def canonical_sign(vector: FloatArray) -> float:
    """1.0 or -1.0, whichever makes the first component that is not zero (to 1e-12) positive."""
    for component in vector[:3]:
        if abs(component) > 1e-12:
            return 1.0 if component > 0 else -1.0
    return 1.0


def sign_free_mean(vectors: FloatArray) -> FloatArray:
    """Mean direction of unit vectors ``(..., k, c)`` whose signs mean nothing: ``(..., c)``, the first one's sign.

    It is the eigenvector of the largest eigenvalue of the sum of outer products; vectors of zeros do not count.
    """
    mean = np.linalg.eigh(vectors.swapaxes(-1, -2) @ vectors)[1][..., -1]
    along = (mean * vectors[..., 0, :]).sum(-1, keepdims=True)
    return np.where(along >= 0, mean, -mean)


def axis_angle(quaternions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit quaternions ``(..., 4)`` as unit axes ``(..., 3)`` and angles ``(...)`` in [0, pi] (paper, section 3, end).

    The identity has no axis; it comes out as the x axis with angle 0.
    """
    quaternions = np.where(quaternions[..., :1] < 0.0, -quaternions, quaternions)
    imaginary = quaternions[..., 1:]
    sine = np.sqrt(np.square(imaginary).sum(-1))
    axes = np.zeros_like(imaginary)
    axes[..., 0] = 1.0
    np.divide(imaginary, sine[..., None], out=axes, where=sine[..., None] > 1e-9)
    return axes, 2.0 * np.arctan2(sine, quaternions[..., 0])
