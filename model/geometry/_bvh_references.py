"""What the tree is built over: boxes around parts of triangles, small enough for it to tell them apart.

One box a triangle will do for nearly all meshes. Where large triangles cross each other, or long ones run side by side,
their boxes overlap, and a query would have to look into most of them, however good the tree. Such triangles are cut at
the planes of a grid, and each part has a box of its own; distances are still taken from the whole triangle.
"""

import numpy as np

from model._jit import jit, jit_allocating
from model.types import FloatArray, IntArray

NEAR = 0.002
"""Part of the surface's extent: how far points that are asked about are from it, typically."""

_FEW = 1.0
"""A point is near so many boxes at most, on average, or the largest are cut smaller."""

CROWDED = 0.25
"""Near so many boxes, on average, they overlap so much that the tree has to be split with care: of nine in ten meshes a
point is near fewer."""

_MOST_CUTS, _CUTS_A_FACE, _FEW_CUTS = 200_000, 20, 2000


@jit_allocating
def references(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """What the tree is built over.

    Returns:
        boxes (m, 6), lower x, y, z, upper x, y, z, that cover the triangles; and the face (m,) that each belongs to.
    """
    count = faces.shape[0]
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for face in range(count):
        for axis in range(3):
            for corner in range(3):
                value = vertices[faces[face, corner], axis]
                low[axis], high[axis] = min(low[axis], value), max(high[axis], value)
    extent = max(high[0] - low[0], high[1] - low[1], high[2] - low[2])
    scale = 1.0 / extent if extent > 1e-100 else 0.0
    boxes = np.empty((count, 6))
    crowd, largest = 0.0, 0.0
    for face in range(count):
        i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
        for axis in range(3):
            a, b, c = vertices[i, axis], vertices[j, axis], vertices[k, axis]
            boxes[face, axis] = min(a, b, c)
            boxes[face, 3 + axis] = max(a, b, c)
        share = _share(boxes, face, scale)
        crowd += share
        largest = max(largest, share)
    owners = np.empty(count, dtype=np.int32)
    for face in range(count):
        owners[face] = face
    if not crowd > _FEW:
        return boxes, owners
    capacity = count + min(_MOST_CUTS, _CUTS_A_FACE * count + _FEW_CUTS)
    cut_boxes, cut_owners = np.empty((capacity, 6)), np.empty(capacity, dtype=np.int32)
    cut_boxes[:count], cut_owners[:count] = boxes, owners
    count = _cut(vertices, faces, cut_boxes, cut_owners, count, low, extent, scale, crowd, largest)
    return cut_boxes[:count].copy(), cut_owners[:count].copy()


@jit
def _share(boxes: FloatArray, box: int, scale: float) -> float:
    """The part of the surface's surroundings that is near a box: how likely a query has to look into it."""
    x = (boxes[box, 3] - boxes[box, 0]) * scale
    y = (boxes[box, 4] - boxes[box, 1]) * scale
    z = (boxes[box, 5] - boxes[box, 2]) * scale
    return x * y * z + 2.0 * NEAR * (x * y + y * z + z * x)


@jit_allocating
def _cut(
    vertices: FloatArray,
    faces: IntArray,
    boxes: FloatArray,
    owners: IntArray,
    count: int,
    low: FloatArray,
    extent: float,
    scale: float,
    crowd: float,
    largest: float,
) -> int:
    """Cut boxes, large ones first, until few are near any point or the arrays are full; how many there are then.

    At planes of a grid that is halved and halved again, always the coarsest that goes through a box: cuts of different
    triangles then coincide, and the tree can separate their parts.
    """
    polygon, clipped = np.empty((12, 3)), np.empty((12, 3))
    below, above = np.empty((1, 6)), np.empty((1, 6))
    while crowd > _FEW and count < boxes.shape[0] and largest > 1e-12:
        largest *= 0.5
        for box in range(count):
            share = _share(boxes, box, scale)
            while share > largest and count < boxes.shape[0]:
                axis = 0
                for other in range(1, 3):
                    if boxes[box, 3 + other] - boxes[box, other] > boxes[box, 3 + axis] - boxes[box, axis]:
                        axis = other
                plane = _coarsest_plane(boxes[box, axis], boxes[box, 3 + axis], low[axis], extent)
                face = owners[box]
                is_below = _part(vertices, faces, face, boxes, box, axis, plane, True, polygon, clipped, below)
                is_above = _part(vertices, faces, face, boxes, box, axis, plane, False, polygon, clipped, above)
                if not (is_below or is_above):  # nothing but rounding
                    break
                if is_below and is_above:
                    boxes[count] = above[0]
                    owners[count] = face
                    crowd += _share(boxes, count, scale)
                    count += 1
                boxes[box] = below[0] if is_below else above[0]
                smaller = _share(boxes, box, scale)
                crowd += smaller - share
                if not smaller < share:
                    break
                share = smaller
            if crowd <= _FEW:
                break
    return count


@jit
def _coarsest_plane(start: float, end: float, origin: float, extent: float) -> float:
    """Where an interval is cut: at the coarsest of the grids' planes inside it."""
    step = extent
    while step > 1e-9 * extent:
        step *= 0.5
        plane = origin + (np.floor((start - origin) / step) + 1.0) * step
        if start < plane < end:
            return plane
    return 0.5 * (start + end)


@jit
def _part(
    vertices: FloatArray,
    faces: IntArray,
    face: int,
    boxes: FloatArray,
    box: int,
    axis: int,
    plane: float,
    below: bool,
    polygon: FloatArray,
    clipped: FloatArray,
    result: FloatArray,
) -> bool:
    """Fill `result` with the box of what of a triangle lies in one of the boxes on one side of a plane, if any does."""
    for corner in range(3):
        for other in range(3):
            polygon[corner, other] = vertices[faces[face, corner], other]
    count = 3
    for other in range(3):
        count = _clip(polygon, count, other, boxes[box, other], 1.0, clipped)
        count = _clip(clipped, count, other, boxes[box, 3 + other], -1.0, polygon)
    count = _clip(polygon, count, axis, plane, -1.0 if below else 1.0, clipped)
    for other in range(3):
        low, high = np.inf, -np.inf
        for corner in range(count):
            low, high = min(low, clipped[corner, other]), max(high, clipped[corner, other])
        # Corners on cuts are rounded: by more than that the part must not be missed.
        margin = 4e-16 * max(abs(low), abs(high))
        result[0, other] = max(low - margin, boxes[box, other])
        result[0, 3 + other] = min(high + margin, boxes[box, 3 + other])
    return count > 0


@jit
def _clip(polygon: FloatArray, count: int, axis: int, plane: float, side: float, result: FloatArray) -> int:
    """The part of a convex polygon on one side of a plane across an axis: how many corners it has."""
    kept = 0
    for corner in range(count):
        after = corner + 1 if corner + 1 < count else 0
        here, there = side * (polygon[corner, axis] - plane), side * (polygon[after, axis] - plane)
        if here >= 0.0:
            for other in range(3):
                result[kept, other] = polygon[corner, other]
            kept += 1
        if (here > 0.0 and there < 0.0) or (here < 0.0 and there > 0.0):
            along = here / (here - there)
            for other in range(3):
                result[kept, other] = polygon[corner, other] + along * (polygon[after, other] - polygon[corner, other])
            result[kept, axis] = plane
            kept += 1
    return kept
