"""Exact closest points with the tree of ``model.geometry._bvh``.

Every triangle is kept in a frame of its own: base along its longest edge, apex above it. There the closest point is a
matter of two coordinates, no division is left to do, and triangles without height or length need no special case: their
frame is exact to rounding, however thin they are.
"""

import numpy as np

from model._jit import jit, jit_allocating
from model.geometry._bvh import FANOUT, LANES, ROWS, STACK
from model.geometry._bvh_lanes import lowest, near_boxes, near_triangles
from model.types import AnyArray, FloatArray, IntArray

_ROUNDING = 1e-15
"""Part of the largest coordinate: what is nearer by less is not looked for. Overlapping triangles of one plane are all
equally far from a point, and each would be looked into for the sake of the last digit."""

_WORK_A_QUERY = 200.0
"""Nodes and leaves that a query may look into on average, beyond `_WORK_AT_FIRST`: on surfaces where boxes can be told
apart it is some ten, and below 200 for a million faces."""

_WORK_AT_FIRST = 0.2
"""Part of all work that queries may do whatever their number."""


@jit_allocating
def pack(
    vertices: FloatArray, faces: IntArray, sources: IntArray, leaves: IntArray, work: float
) -> tuple[FloatArray, IntArray]:
    """Frames and owners of all leaves, see ``_bvh``; `sources` are the faces of the sorted references."""
    frames = np.empty(leaves.shape[0] * ROWS * LANES + 3)
    largest = 0.0
    for face in range(faces.shape[0]):
        for axis in range(3):
            largest = max(largest, abs(vertices[faces[face, 0], axis]))
    frames[-3], frames[-2], frames[-1] = _WORK_AT_FIRST * work, _ROUNDING * largest, work
    owners = np.empty(leaves.shape[0] * LANES, dtype=np.int32)
    for leaf in range(leaves.shape[0]):
        for lane in range(LANES):
            face = int(sources[min(leaves[leaf, 0] + lane, leaves[leaf, 1] - 1)])
            owners[leaf * LANES + lane] = face
            _frame(vertices, faces, face, frames, leaf * ROWS * LANES + lane)
    return frames, owners


@jit
def _frame(vertices: FloatArray, faces: IntArray, face: int, frames: FloatArray, at: int) -> None:
    """Rows: origin (3), x axis along the longest edge (3), y axis (3), base length, apex x and y, 1 / side^2 (2)."""
    i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
    ij, jk, ki = 0.0, 0.0, 0.0
    for axis in range(3):
        ij += (vertices[j, axis] - vertices[i, axis]) ** 2
        jk += (vertices[k, axis] - vertices[j, axis]) ** 2
        ki += (vertices[i, axis] - vertices[k, axis]) ** 2
    if jk >= ij and jk >= ki:
        i, j, k = j, k, i
    elif ki >= ij:
        i, j, k = k, i, j
    ox, oy, oz = vertices[i, 0], vertices[i, 1], vertices[i, 2]
    bx, by, bz = vertices[j, 0] - ox, vertices[j, 1] - oy, vertices[j, 2] - oz
    cx, cy, cz = vertices[k, 0] - ox, vertices[k, 1] - oy, vertices[k, 2] - oz
    base = np.sqrt(bx * bx + by * by + bz * bz)
    if base > 0.0:
        bx, by, bz = bx / base, by / base, bz / base
    else:
        bx, by, bz = 1.0, 0.0, 0.0
    x = cx * bx + cy * by + cz * bz
    hx, hy, hz = cx - x * bx, cy - x * by, cz - x * bz
    y = np.sqrt(hx * hx + hy * hy + hz * hz)
    if y <= 1e-15 * base:  # no height beyond rounding: any perpendicular will do
        y = 0.0
        if abs(bx) <= abs(by) and abs(bx) <= abs(bz):
            hx, hy, hz = 0.0, -bz, by
        elif abs(by) <= abs(bz):
            hx, hy, hz = bz, 0.0, -bx
        else:
            hx, hy, hz = -by, bx, 0.0
    # Once more against the x axis: for a thin triangle the first difference is not perpendicular enough.
    length = np.sqrt(hx * hx + hy * hy + hz * hz)
    hx, hy, hz = hx / length, hy / length, hz / length
    dot = hx * bx + hy * by + hz * bz
    hx, hy, hz = hx - dot * bx, hy - dot * by, hz - dot * bz
    length = np.sqrt(hx * hx + hy * hy + hz * hz)
    hx, hy, hz = hx / length, hy / length, hz / length
    left, right = x * x + y * y, (x - base) * (x - base) + y * y
    frames[at], frames[at + LANES], frames[at + 2 * LANES] = ox, oy, oz
    frames[at + 3 * LANES], frames[at + 4 * LANES], frames[at + 5 * LANES] = bx, by, bz
    frames[at + 6 * LANES], frames[at + 7 * LANES], frames[at + 8 * LANES] = hx, hy, hz
    frames[at + 9 * LANES], frames[at + 10 * LANES], frames[at + 11 * LANES] = base, x, y
    frames[at + 12 * LANES] = 1.0 / left if left > 0.0 else 0.0
    frames[at + 13 * LANES] = 1.0 / right if right > 0.0 else 0.0


@jit
def _beaten(squared: float, rounding: float) -> float:
    """The squared distance of boxes that hold nothing nearer, but for rounding."""
    distance = max(np.sqrt(squared) - rounding, 0.0)
    return distance * distance


@jit
def nearest(
    x: float,
    y: float,
    z: float,
    seed: int,
    bound: float,
    boxes: FloatArray,
    children: IntArray,
    frames: FloatArray,
    waiting: IntArray,
    waiting_squared: FloatArray,
    child_squared: FloatArray,
    leaf_squared: FloatArray,
) -> tuple[float, int]:
    """Squared distance of a point and the leaf lane it was found in; the bound and -1 if nothing is closer (squared).

    The search begins in the leaf `seed`: if it is near, it prunes the tree at once. The last four arrays are scratch
    of length `STACK`, `STACK`, `FANOUT` and `LANES`.

    Every node and leaf that is looked into counts as one unit of the work that the tree may do, see `charge`. Once that
    is used up, only the leaf `seed` is looked into: the caller must ask `SurfaceIndex.require_work` before it believes
    what a kernel found. (Threads that share a tree may lose some of each other's counts.)
    """
    last = frames.shape[0] - 1
    rounding = float(frames[last - 1])
    visits = 0
    best, found = bound, -1
    bits = near_triangles(frames, seed * ROWS * LANES, x, y, z, best, leaf_squared)
    while bits:
        lane = lowest(bits)
        bits &= bits - 1
        if leaf_squared[lane] < best:
            best, found = float(leaf_squared[lane]), seed * LANES + lane
    enough = _beaten(best, rounding)
    waiting[0], waiting_squared[0] = 0, 0.0
    top = 1 if frames[last] > 0.0 else 0
    while top > 0:
        top -= 1
        if waiting_squared[top] >= enough:
            continue
        visits += 1
        node = waiting[top]
        if node < 0:
            if ~node != seed:
                bits = near_triangles(frames, ~node * ROWS * LANES, x, y, z, best, leaf_squared)
                if bits:
                    while bits:
                        lane = lowest(bits)
                        bits &= bits - 1
                        if leaf_squared[lane] < best:
                            best, found = float(leaf_squared[lane]), ~node * LANES + lane
                    enough = _beaten(best, rounding)
            continue
        bits = near_boxes(boxes, node * 6 * FANOUT, x, y, z, enough, child_squared)
        bottom = top
        while bits:  # kept sorted, the nearest on top
            child = lowest(bits)
            bits &= bits - 1
            value = child_squared[child]
            place = top
            while place > bottom and waiting_squared[place - 1] < value:
                waiting_squared[place], waiting[place] = waiting_squared[place - 1], waiting[place - 1]
                place -= 1
            waiting_squared[place], waiting[place] = value, children[node * FANOUT + child]
            top += 1
    charge(frames, visits)
    return best, found


@jit
def charge(frames: FloatArray, visits: int) -> None:
    """Count what a query has cost: of all the work that queries may do, and of what so many of them may."""
    last = frames.shape[0] - 1
    frames[last] -= visits
    frames[last - 2] += _WORK_A_QUERY - visits
    if frames[last - 2] < 0.0:  # a search asks for so much that it would not end
        frames[last] = min(frames[last], 0.0)


@jit_allocating
def search(
    points: FloatArray,
    order: IntArray,
    boxes: FloatArray,
    children: IntArray,
    frames: FloatArray,
    bound: float,
    stop_above: float,
    squared: FloatArray,
    lanes_found: AnyArray,
) -> float:
    """Squared distance of every point, visited in the given order, and the leaf lane where it was found.

    Only surface closer than `bound` (squared) counts; lane -1 and infinity where there is none. The search ends early,
    leaving the rest of the outputs unset, when the sum of the squared distances exceeds `stop_above`.

    Returns:
        The sum of the squared distances so far.
    """
    waiting, waiting_squared = np.empty(STACK, dtype=np.int32), np.empty(STACK)
    child_squared, leaf_squared = np.empty(FANOUT), np.empty(LANES)
    total = 0.0
    recent = 0  # the leaf nearest to the previous point: likely near this one too
    for step in range(order.shape[0]):
        point = order[step]
        x, y, z = points[point, 0], points[point, 1], points[point, 2]
        best, found = nearest(
            x,
            y,
            z,
            recent,
            bound,
            boxes,
            children,
            frames,
            waiting,
            waiting_squared,
            child_squared,
            leaf_squared,
        )
        if found >= 0:
            recent = found // LANES
        else:
            best = np.inf
        squared[point] = best
        lanes_found[point] = found
        total += best
        if total > stop_above:
            break
    return total


@jit
def closest_on(x: float, y: float, z: float, lane: int, frames: FloatArray) -> tuple[float, float, float]:
    """The point of the triangle in a leaf lane that is closest to a point."""
    at = lane // LANES * ROWS * LANES + lane % LANES
    base, cx, cy = frames[at + 9 * LANES], frames[at + 10 * LANES], frames[at + 11 * LANES]
    px, py, pz = x - frames[at], y - frames[at + LANES], z - frames[at + 2 * LANES]
    u = px * frames[at + 3 * LANES] + py * frames[at + 4 * LANES] + pz * frames[at + 5 * LANES]
    v = px * frames[at + 6 * LANES] + py * frames[at + 7 * LANES] + pz * frames[at + 8 * LANES]
    ru, rx = u - base, cx - base
    if v < 0.0:
        u, v = min(max(u, 0.0), base), 0.0
    elif cy <= 0.0 or min(u * cy - v * cx, v * rx - ru * cy) < 0.0:
        s = min(max((u * cx + v * cy) * frames[at + 12 * LANES], 0.0), 1.0)
        t = min(max((ru * rx + v * cy) * frames[at + 13 * LANES], 0.0), 1.0)
        left = (u - s * cx) ** 2 + (v - s * cy) ** 2
        right = (ru - t * rx) ** 2 + (v - t * cy) ** 2
        if left <= right:
            u, v = s * cx, s * cy
        else:
            u, v = base + t * rx, t * cy
    return (
        frames[at] + u * frames[at + 3 * LANES] + v * frames[at + 6 * LANES],
        frames[at + LANES] + u * frames[at + 4 * LANES] + v * frames[at + 7 * LANES],
        frames[at + 2 * LANES] + u * frames[at + 5 * LANES] + v * frames[at + 8 * LANES],
    )


@jit
def normal_of(lane: int, frames: FloatArray) -> tuple[float, float, float]:
    """The unit normal of the triangle in a leaf lane, either way."""
    at = lane // LANES * ROWS * LANES + lane % LANES
    bx, by, bz = frames[at + 3 * LANES], frames[at + 4 * LANES], frames[at + 5 * LANES]
    hx, hy, hz = frames[at + 6 * LANES], frames[at + 7 * LANES], frames[at + 8 * LANES]
    return by * hz - bz * hy, bz * hx - bx * hz, bx * hy - by * hx


@jit
def closest_points(points: FloatArray, lanes_found: AnyArray, frames: FloatArray, result: FloatArray) -> None:
    """The point of the triangle in the given lane that is closest to each point; NaN for lane -1."""
    for point in range(points.shape[0]):
        if lanes_found[point] < 0:
            result[point] = np.nan
            continue
        x, y, z = points[point, 0], points[point, 1], points[point, 2]
        result[point, 0], result[point, 1], result[point, 2] = closest_on(x, y, z, lanes_found[point], frames)


@jit_allocating
def morton_order(points: FloatArray) -> IntArray:
    """Indices that visit the points along a space-filling curve, so that neighbours follow each other."""
    count = points.shape[0]
    low = np.full(3, np.inf)
    high = np.full(3, -np.inf)
    for point in range(count):
        for axis in range(3):
            low[axis] = min(low[axis], points[point, axis])
            high[axis] = max(high[axis], points[point, axis])
    width = max(high[0] - low[0], high[1] - low[1], high[2] - low[2])
    scale = 1023.0 / width if width > 1e-290 else 0.0
    keys = np.empty(count, dtype=np.int32)
    for point in range(count):
        key = 0
        for axis in range(3):
            cell = int((points[point, axis] - low[axis]) * scale)
            cell = (cell | (cell << 16)) & 0x030000FF
            cell = (cell | (cell << 8)) & 0x0300F00F
            cell = (cell | (cell << 4)) & 0x030C30C3
            cell = (cell | (cell << 2)) & 0x09249249
            key |= cell << axis
        keys[point] = key
    order = np.empty(count, dtype=np.int32)
    for point in range(count):
        order[point] = point
    sorted_keys = np.empty(count, dtype=np.int32)
    sorted_order = np.empty(count, dtype=np.int32)
    starts = np.empty(1024, dtype=np.int64)
    for shift in range(0, 30, 10):
        starts[:] = 0
        for point in range(count):
            starts[(keys[point] >> shift) & 1023] += 1
        total = 0
        for digit in range(1024):
            total, starts[digit] = total + starts[digit], total
        for point in range(count):
            digit = (keys[point] >> shift) & 1023
            place = starts[digit]
            starts[digit] += 1
            sorted_keys[place], sorted_order[place] = keys[point], order[point]
        keys, sorted_keys = sorted_keys, keys
        order, sorted_order = sorted_order, order
    return order
