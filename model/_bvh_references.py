"""What goes into the tree of ``model._bvh``: a box for every triangle, several for long diagonal ones."""

import numpy as np

from model._jit import jit, jit_inline
from model.types import FloatArray, IntArray


@jit
def references(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Boxes (m, 6) around the triangles and the face index of each (m,).

    A box much larger than its triangle attracts many useless visits. Such triangles are bisected at their longest edge
    until the boxes are small compared with the others; the number of references at most triples.
    """
    count = faces.shape[0]
    box = np.empty(6)
    total, wasteful, plain = 0.0, 0.0, 0
    for face in range(count):
        area, waste = _enclose(vertices, faces, face, box)
        total += area
        if waste:
            wasteful += area
        else:
            plain += 1
    budget, limit = 0, np.inf
    if wasteful > 0.0:
        budget = 2 * count
        limit = wasteful / budget
        if plain > 0:
            limit = max(limit, 0.25 * (total - wasteful) / plain)
    boxes = np.empty((count + budget, 6))
    owners = np.empty(count + budget, dtype=np.int32)
    pieces = np.empty((64, 9))
    found = 0
    for face in range(count):
        area, waste = _enclose(vertices, faces, face, box)
        if not waste or area <= limit:
            boxes[found] = box
            owners[found] = face
            found += 1
            continue
        for corner in range(3):
            for axis in range(3):
                pieces[0, 3 * corner + axis] = vertices[faces[face, corner], axis]
        waiting = 1
        while waiting > 0:
            waiting -= 1
            area, waste = _enclose_piece(pieces, waiting, box)
            # Room is left for every piece that waits and every face to come.
            room = boxes.shape[0] - found - waiting - (count - face - 1)
            if waste and area > limit and room >= 2 and waiting + 2 <= pieces.shape[0]:
                _bisect(pieces, waiting)
                waiting += 2
            else:
                boxes[found] = box
                owners[found] = face
                found += 1
    return boxes[:found].copy(), owners[:found].copy()


@jit_inline
def _enclose(vertices: FloatArray, faces: IntArray, face: int, box: FloatArray) -> tuple[float, bool]:
    """Box of a triangle; half its surface, and whether that is far more than the triangle's own."""
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    for axis in range(3):
        box[axis] = min(vertices[a, axis], vertices[b, axis], vertices[c, axis])
        box[3 + axis] = max(vertices[a, axis], vertices[b, axis], vertices[c, axis])
    px, py, pz = (
        vertices[b, 0] - vertices[a, 0],
        vertices[b, 1] - vertices[a, 1],
        vertices[b, 2] - vertices[a, 2],
    )
    qx, qy, qz = (
        vertices[c, 0] - vertices[a, 0],
        vertices[c, 1] - vertices[a, 1],
        vertices[c, 2] - vertices[a, 2],
    )
    return _waste(box[3] - box[0], box[4] - box[1], box[5] - box[2], px, py, pz, qx, qy, qz)


@jit_inline
def _enclose_piece(pieces: FloatArray, piece: int, box: FloatArray) -> tuple[float, bool]:
    """The same for a piece of a triangle, nine coordinates in a row."""
    for axis in range(3):
        a, b, c = pieces[piece, axis], pieces[piece, 3 + axis], pieces[piece, 6 + axis]
        box[axis], box[3 + axis] = min(a, b, c), max(a, b, c)
    px, py, pz = (
        pieces[piece, 3] - pieces[piece, 0],
        pieces[piece, 4] - pieces[piece, 1],
        pieces[piece, 5] - pieces[piece, 2],
    )
    qx, qy, qz = (
        pieces[piece, 6] - pieces[piece, 0],
        pieces[piece, 7] - pieces[piece, 1],
        pieces[piece, 8] - pieces[piece, 2],
    )
    return _waste(box[3] - box[0], box[4] - box[1], box[5] - box[2], px, py, pz, qx, qy, qz)


@jit_inline
def _waste(
    dx: float, dy: float, dz: float, px: float, py: float, pz: float, qx: float, qy: float, qz: float
) -> tuple[float, bool]:
    half_surface = dx * dy + dy * dz + dz * dx
    x, y, z = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    return half_surface, half_surface > 4.0 * np.sqrt(x * x + y * y + z * z)


@jit
def _bisect(pieces: FloatArray, piece: int) -> None:
    """Replace a piece by its two halves, the second one in the next row."""
    longest, start = -1.0, 0
    for edge in range(3):
        length = 0.0
        for axis in range(3):
            length += (pieces[piece, 3 * ((edge + 1) % 3) + axis] - pieces[piece, 3 * edge + axis]) ** 2
        if length > longest:
            longest, start = length, edge
    end = (start + 1) % 3
    for column in range(9):
        pieces[piece + 1, column] = pieces[piece, column]
    for axis in range(3):
        # The midpoint lies in the box of the edge's ends also after rounding, so the halves cover the piece.
        middle = 0.5 * (pieces[piece, 3 * start + axis] + pieces[piece, 3 * end + axis])
        pieces[piece, 3 * end + axis] = middle
        pieces[piece + 1, 3 * start + axis] = middle
