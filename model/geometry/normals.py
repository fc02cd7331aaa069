"""Normals of faces."""

import numpy as np

from model._jit import jit, kernel_array
from model.types import FloatArray, IntArray


def face_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Unit normals ``(f, 3)``; zero where a face has no area."""
    result = np.empty((len(faces), 3))
    _normals(kernel_array(vertices, np.float64), kernel_array(faces, np.int32), result)
    return result


@jit
def _normals(vertices: FloatArray, faces: IntArray, result: FloatArray) -> None:
    for face in range(faces.shape[0]):
        i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, az = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
        bx, by, bz = vertices[k, 0] - vertices[i, 0], vertices[k, 1] - vertices[i, 1], vertices[k, 2] - vertices[i, 2]
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        length = np.sqrt(x * x + y * y + z * z)
        if length > 0.0:
            x, y, z = x / length, y / length, z / length
        result[face, 0], result[face, 1], result[face, 2] = x, y, z
