"""What is done about a file that is not quite a mesh: points are joined, broken faces left out, doubts are told."""

from dataclasses import replace

import numpy as np

from model._jit import jit, kernel_array
from model.formats._common import RawMesh
from model.meshes.mesh import LARGEST_COORDINATE, Mesh
from model.meshes.points import surface_of_points
from model.types import AnyArray, FloatArray, IntArray

_MOST_BROKEN = 0.05
"""Share of a file's faces that may be left out; beyond it the file is refused."""

_FAR = 50.0
"""So many times its own size a shape must be from the origin before the resolution of its coordinates is looked at."""

_COARSE = 1e-5
"""Share of a shape's size from which on the resolution of its coordinates is worth a warning."""

_LOOKED_AT = 2000
_SHORTEST, _LONGEST = 5, 8
"""Significant digits that text files are tried for."""


def without_broken_faces(raw: RawMesh) -> RawMesh:
    """The mesh without faces that refer to vertices that do not exist or are not finite, if they are few.

    Where they are many nothing is left out, and the checks of `Mesh` say what is wrong.
    """
    vertices, faces = kernel_array(raw.vertices, np.float64), raw.faces
    if faces.dtype != np.int32 or faces.ndim != 2 or vertices.ndim != 2:
        return raw
    marks = np.zeros(len(faces), dtype=np.uint8)
    broken = int(_mark_broken(vertices, kernel_array(faces, np.int32), LARGEST_COORDINATE, marks))
    if broken == 0 or broken > _MOST_BROKEN * len(faces):
        return raw
    some = "1 face was" if broken == 1 else f"{broken} faces were"
    warning = f"{some} left out: a corner is missing or not a finite number."
    kept = marks == 0
    return replace(
        raw,
        vertices=vertices,
        faces=faces[kept],
        warnings=(*raw.warnings, warning),
        texture=None if raw.texture is None else raw.texture.part(kept),
    )


def joined_points(raw: RawMesh) -> RawMesh:
    """A point cloud with triangles between its points; colours of points are left out.

    Raises:
        EmptyMeshError: there are too few points.
        DegenerateMeshError: they coincide.
    """
    found = surface_of_points(kernel_array(raw.vertices, np.float64).reshape(-1, 3), LARGEST_COORDINATE)
    kept, total = len(found.vertices), len(raw.vertices)
    said = [f"The file holds a point cloud: {total} points, of which {kept} were joined to a surface."]
    if found.outliers:
        said.append(f"{found.outliers} points stand alone and were left out.")
    if found.broken:
        said.append(f"{found.broken} points without finite coordinates were left out.")
    return RawMesh(found.vertices, found.faces, raw.units, (*raw.warnings, *said))


@jit
def _mark_broken(vertices: FloatArray, faces: IntArray, largest: float, marks: AnyArray) -> int:
    broken = 0
    for face in range(faces.shape[0]):
        for corner in range(3):
            vertex = faces[face, corner]
            fine = 0 <= vertex < vertices.shape[0]
            if fine:
                for axis in range(3):
                    fine = fine and abs(vertices[vertex, axis]) <= largest  # NaN is not
            if not fine:
                marks[face] = 1
        broken += marks[face]
    return broken


def resolution_warning(mesh: Mesh) -> tuple[str, ...]:
    """A warning where a shape is so far from the origin that its numbers are coarse: none, or one sentence."""
    low, high = mesh.bounds
    extent, farthest = float((high - low).max()), float(max(abs(low).max(), abs(high).max()))
    if farthest < _FAR * extent:
        return ()
    resolution = _resolution(mesh, farthest)
    if resolution < _COARSE * extent:
        return ()
    return (
        f"The coordinates lie {farthest / extent:.2g} times farther from the origin than the shape is large, and "
        f"resolve only {resolution:.2g} of its {extent:.2g}; export it near the origin, or with more digits.",
    )


def _resolution(mesh: Mesh, farthest: float) -> float:
    """The step between neighbouring coordinates of that size, by the digits that the numbers have."""
    used = np.unique(mesh.faces[:: max(1, 3 * len(mesh.faces) // _LOOKED_AT)])
    values = mesh.vertices[used].ravel()
    step = float(np.spacing(farthest))
    for digits in range(_SHORTEST, _LONGEST + 1):
        if all(float(f"{value:.{digits - 1}e}") == value for value in values.tolist()):
            if digits == _SHORTEST:
                return step  # round numbers, which may well be meant as they are
            step = 10.0 ** (np.floor(np.log10(farthest)) - digits + 1)
            break
    with np.errstate(over="ignore", under="ignore"):
        single = values.astype(np.float32)
    if (single == values).all():
        step = max(step, float(np.spacing(np.float32(farthest))))
    return float(step)
