"""A shape as a function on a grid: the Euclidean distance transform of its voxels, as three of the rivals use it."""

import numpy as np
from scipy.ndimage import distance_transform_edt, map_coordinates

from model.geometry.voxels import voxelize
from model.types import AnyArray, FloatArray, IntArray


class Volume:
    """A function of the distance from the surface on a cube of voxels about the origin.

    Attributes:
        values: ``(R, R, R)`` float32 at the voxels' centres.
        half: half the edge of the cube, unit frame.
    """

    def __init__(self, values: AnyArray, half: float) -> None:
        self.values = values
        self.half = half

    @property
    def voxel(self) -> float:
        """Edge of a voxel, unit frame."""
        return 2.0 * self.half / len(self.values)

    def at(self, points: FloatArray) -> AnyArray:
        """The function at points ``(..., 3)`` of the unit frame, interpolated linearly; zero outside the cube."""
        places = (points / self.voxel + (len(self.values) - 1) / 2.0).reshape(-1, 3).T
        return map_coordinates(self.values, places, order=1, mode="constant").reshape(points.shape[:-1])

    def centres(self) -> FloatArray:
        """The centres of all voxels ``(R^3, 3)``, in the order of ``values.ravel()``."""
        line: FloatArray = (np.arange(len(self.values), dtype=np.float64) + 0.5) * self.voxel - self.half
        return np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)


def distance_volume(vertices: FloatArray, faces: IntArray, resolution: int, half: float) -> Volume:
    """Distances from the surface, unit frame, measured from voxel to voxel.

    Args:
        vertices: ``(v, 3)``, unit frame.
        faces: ``(f, 3)``.
        resolution: voxels along an edge.
        half: half the edge of the cube; what of the shape lies outside is ignored.
    """
    occupied = voxelize(np.ascontiguousarray(vertices * (0.5 / half)), faces, resolution)
    voxel = 2.0 * half / resolution
    distances: AnyArray = np.asarray(distance_transform_edt(~occupied))
    return Volume((distances * voxel).astype(np.float32), half)


def gaussian_volume(vertices: FloatArray, faces: IntArray, resolution: int, half: float, falloff: float) -> Volume:
    """The Gaussian Euclidean distance transform (GEDT): exp(-(distance / falloff)^2), ``falloff`` in voxels."""
    volume = distance_volume(vertices, faces, resolution, half)
    return Volume(np.exp(-np.square(volume.values / (falloff * volume.voxel))), half)
