"""The triangles of the tree of ``model.geometry._bvh`` in cells, by a space-filling curve and not by splitting.

Splitting costs every triangle one step a level, some twenty of a million triangles. Here triangles are sorted once by
the Morton code of their middle; cells of an octree with few of them become the lowest nodes, and only above these the
tree is built by splitting. A query looks into about as many nodes either way, but where boxes crowd. Boxes of triangles
are computed where they are needed: keeping them takes longer, most of it for memory that was not used before.
"""

import numpy as np

from model._jit import jit, jit_allocating, jit_inlined
from model.geometry._bvh import CELL, FANOUT, LANES
from model.geometry._bvh_references import CROWDED, NEAR
from model.geometry._morton import BITS, code, code_of, index_of, row_of, scale_of, sort_rows
from model.types import AnyArray, FloatArray, IntArray

_ALONE = 16.0
"""A box whose surface is so many times the mean is no part of a cell, which it would make large."""


@jit
def survey(vertices: FloatArray, faces: IntArray, found: FloatArray) -> bool:
    """Whether boxes around triangles ``(f, 3)`` crowd, so that cells are no good.

    ``found`` ``(7,)`` is filled: the lowest and highest of their doubled middles x, y, z, half the surface of all.
    """
    ax, ay, az, bx, by, bz = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    cx, cy, cz, dx, dy, dz = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    surface, volume = 0.0, 0.0
    for face in range(faces.shape[0]):
        lx, ly, lz, hx, hy, hz = box_of(vertices, faces, face)
        ax, ay, az = min(ax, lx), min(ay, ly), min(az, lz)
        bx, by, bz = max(bx, hx), max(by, hy), max(bz, hz)
        cx, cy, cz = min(cx, lx + hx), min(cy, ly + hy), min(cz, lz + hz)
        dx, dy, dz = max(dx, lx + hx), max(dy, ly + hy), max(dz, lz + hz)
        x, y, z = hx - lx, hy - ly, hz - lz
        surface += x * y + y * z + z * x
        volume += x * y * z
    found[0], found[1], found[2], found[3], found[4], found[5] = cx, cy, cz, dx, dy, dz
    found[6] = surface
    extent = max(bx - ax, by - ay, bz - az)
    scale = 1.0 / extent if extent > 1e-100 else 0.0
    return volume * scale * scale * scale + 2.0 * NEAR * surface * scale * scale > CROWDED


@jit_inlined
def box_of(vertices: FloatArray, faces: IntArray, face: int) -> tuple[float, float, float, float, float, float]:
    """Lower x, y, z, upper x, y, z of a triangle."""
    i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
    ax, ay, az = vertices[i, 0], vertices[i, 1], vertices[i, 2]
    bx, by, bz = vertices[j, 0], vertices[j, 1], vertices[j, 2]
    cx, cy, cz = vertices[k, 0], vertices[k, 1], vertices[k, 2]
    return min(ax, bx, cx), min(ay, by, cy), min(az, bz, cz), max(ax, bx, cx), max(ay, by, cy), max(az, bz, cz)


@jit_allocating
def sort_into_cells(
    vertices: FloatArray, faces: IntArray, found: FloatArray, rows: AnyArray, sorted_rows: AnyArray
) -> tuple[IntArray, FloatArray, bool]:
    """Sort triangles into cells.

    Args:
        vertices: (v, 3).
        faces: (f, 3).
        found: (7,) what `survey` found.
        rows: (f,) int64, scratch.
        sorted_rows: (f,) int64, filled with the triangles in order (``_morton.index_of``).

    Returns:
        (c, 2) which range of the rows each cell is, (c, 6) boxes of the cells, and whether many triangles had one
        centre: they may be one, many times.
    """
    count = faces.shape[0]
    inside = _code_all(vertices, faces, found, rows)
    cells = np.empty((count, 2), dtype=np.int32)
    known = 0
    crowded = False
    # Ranges that are to be sorted, last in, first out: what shares a cell of the finest grid is sorted again by itself.
    waiting = np.empty((count // CELL + 2, 2), dtype=np.int32)
    waiting[0, 0], waiting[0, 1] = 0, inside
    left, coded = 1, True
    starts = np.empty((3, 1 << BITS), dtype=np.int64)
    while left > 0:
        left -= 1
        first, last = int(waiting[left, 0]), int(waiting[left, 1])
        coincide = not coded and _code(vertices, faces, sorted_rows, first, last, rows)
        coded = False
        if not coincide:
            sort_rows(rows, sorted_rows, first, last, starts)
        place = first
        while place < last:
            end = _cell_end(sorted_rows, place, first, last)
            if end - place > CELL and not coincide:
                waiting[left, 0], waiting[left, 1] = place, end
                left += 1
                place = end
                continue
            if end - place > CELL:
                crowded = True
                end = place + CELL
            cells[known, 0], cells[known, 1] = place, end
            known += 1
            place = end
    for place in range(inside, count):
        sorted_rows[place] = rows[place]
        cells[known, 0], cells[known, 1] = place, place + 1
        known += 1
    boxes = np.empty((known, 6))
    for cell in range(known):
        _cover(vertices, faces, sorted_rows, cells[cell, 0], cells[cell, 1], boxes[cell])
    return cells[:known].copy(), boxes, crowded


@jit_allocating
def with_cells(top_children: IntArray, cells: IntArray, order: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Give numbers to the nodes and leaves of cells below the nodes above them (``_bvh_split``).

    Args:
        top_children: of the nodes above, ~cell where a child is a cell.
        cells: (c, 2) which range of ``order`` each cell is.
        order: (m,) triangles.

    Returns:
        children, cells and owners as in ``_bvh.Tree``: a cell of one leaf has no node, and its triangles are set.
    """
    upper = top_children.shape[0] // FANOUT
    lower, leaves = 0, 0
    for cell in range(cells.shape[0]):
        parts = (cells[cell, 1] - cells[cell, 0] + LANES - 1) // LANES
        lower, leaves = lower + (1 if parts > 1 else 0), leaves + parts
    children = np.empty((upper + lower) * FANOUT, dtype=np.int32)
    rows = np.empty((lower, 3), dtype=np.int32)
    lanes = np.empty(leaves * LANES, dtype=np.int32)
    nodes, found = 0, 0
    for slot in range(top_children.shape[0]):
        children[slot] = top_children[slot]
        if top_children[slot] >= 0:
            continue
        cell = ~top_children[slot]
        start, end = int(cells[cell, 0]), int(cells[cell, 1])
        if end - start > LANES:
            children[slot] = upper + nodes
            rows[nodes, 0], rows[nodes, 1], rows[nodes, 2] = start, end, found
            nodes += 1
        else:
            children[slot] = ~found
            for lane in range(LANES):
                lanes[found * LANES + lane] = order[min(start + lane, end - 1)]
        found += (end - start + LANES - 1) // LANES
    return children, rows, lanes


@jit
def _cover(vertices: FloatArray, faces: IntArray, rows: AnyArray, start: int, end: int, box: FloatArray) -> None:
    """Fill `box` with what covers a range of the sorted triangles."""
    ax, ay, az, bx, by, bz = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    for place in range(start, end):
        lx, ly, lz, hx, hy, hz = box_of(vertices, faces, index_of(rows[place]))
        ax, ay, az = min(ax, lx), min(ay, ly), min(az, lz)
        bx, by, bz = max(bx, hx), max(by, hy), max(bz, hz)
    box[0], box[1], box[2], box[3], box[4], box[5] = ax, ay, az, bx, by, bz


@jit
def _code_all(vertices: FloatArray, faces: IntArray, found: FloatArray, rows: AnyArray) -> int:
    """Fill ``rows`` ``(f,)``; the largest come last, without a code: how many are before them."""
    count = faces.shape[0]
    ax, ay, az = found[0], found[1], found[2]
    scale = scale_of(found[3] - ax, found[4] - ay, found[5] - az)
    limit = found[6] / count * _ALONE
    inside, outside = 0, count
    for face in range(count):
        lx, ly, lz, hx, hy, hz = box_of(vertices, faces, face)
        x, y, z = hx - lx, hy - ly, hz - lz
        if x * y + y * z + z * x > limit:
            outside -= 1
            rows[outside] = face
        else:
            key = code(int((lx + hx - ax) * scale), int((ly + hy - ay) * scale), int((lz + hz - az) * scale))
            rows[inside] = row_of(key, face)
            inside += 1
    return inside


@jit
def _code(vertices: FloatArray, faces: IntArray, sorted_rows: AnyArray, first: int, last: int, rows: AnyArray) -> bool:
    """Fill ``rows[first:last]`` with codes in the range's own box of middles; whether all are at one place."""
    ax, ay, az, bx, by, bz = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    for place in range(first, last):
        lx, ly, lz, hx, hy, hz = box_of(vertices, faces, index_of(sorted_rows[place]))
        ax, ay, az = min(ax, lx + hx), min(ay, ly + hy), min(az, lz + hz)
        bx, by, bz = max(bx, lx + hx), max(by, ly + hy), max(bz, lz + hz)
    scale = scale_of(bx - ax, by - ay, bz - az)
    for place in range(first, last):
        face = index_of(sorted_rows[place])
        lx, ly, lz, hx, hy, hz = box_of(vertices, faces, face)
        key = code(int((lx + hx - ax) * scale), int((ly + hy - ay) * scale), int((lz + hz - az) * scale))
        rows[place] = row_of(key, face)
    return scale == 0.0


@jit
def _cell_end(rows: AnyArray, place: int, first: int, last: int) -> int:
    """The end of the largest cell that begins at a place and has few references; of the finest one, if it has many."""
    level = 0
    end = place + 1
    while end < last and code_of(rows[end]) == code_of(rows[place]):
        end += 1
    if end - place > CELL:
        return end
    while level < 3 * BITS:
        level += 1
        if place > first and code_of(rows[place - 1]) >> level == code_of(rows[place]) >> level:
            break
        reach = place + CELL
        if reach < last and code_of(rows[reach]) >> level == code_of(rows[place]) >> level:
            break
        while end < last and end < reach and code_of(rows[end]) >> level == code_of(rows[place]) >> level:
            end += 1
    return end
