"""Triangles in the leaves of the tree, each in a frame of its own: base along its longest edge, apex above it.

There the closest point is a matter of two coordinates, no division is left to do, and triangles without height or
length need no special case: their frame is exact to rounding, however thin they are.
"""

import numpy as np

from model._atomic import claim, publish, published, take, wait_for
from model._jit import jit, jit_inlined
from model.geometry._bvh import LANES, ROWS, Tree
from model.geometry._bvh_lanes import near_triangles
from model.types import FloatArray, IntArray


@jit_inlined
def near_leaf(leaf: int, x: float, y: float, z: float, enough: float, tree: Tree, squared: FloatArray) -> int:
    """Fill ``squared`` ``(LANES,)`` with the squared distances of the triangles; a bit for each below ``enough``."""
    return near_triangles(tree.frames, frames_of(leaf, tree) * ROWS * LANES, x, y, z, enough, squared)


@jit_inlined
def frames_of(leaf: int, tree: Tree) -> int:
    """Where the frames of a leaf are, counted in leaves; they are made if they are not."""
    place = published(tree.frames_of, leaf)
    return place if place > 0 else _made(leaf, tree)


@jit
def _made(leaf: int, tree: Tree) -> int:
    if not claim(tree.frames_of, leaf):
        return wait_for(tree.frames_of, leaf)
    place = take(tree.taken, 1)
    for lane in range(LANES):
        _frame(
            tree.vertices,
            tree.faces,
            int(tree.owners[leaf * LANES + lane]),
            tree.frames,
            place * ROWS * LANES + lane,
        )
    publish(tree.frames_of, leaf, place)
    return place


@jit
def _frame(vertices: FloatArray, faces: IntArray, face: int, frames: FloatArray, at: int) -> None:
    """Rows: origin (3), x axis along the longest edge (3), y axis (3), base, apex x and y, 1 / side^2 (2)."""
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
def closest_on(x: float, y: float, z: float, lane: int, tree: Tree) -> tuple[float, float, float]:
    """The point of the triangle in a leaf lane that is closest to a point."""
    frames = tree.frames
    at = frames_of(lane // LANES, tree) * ROWS * LANES + lane % LANES
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
def normal_of(lane: int, tree: Tree) -> tuple[float, float, float]:
    """The unit normal of the triangle in a leaf lane, either way."""
    frames = tree.frames
    at = frames_of(lane // LANES, tree) * ROWS * LANES + lane % LANES
    bx, by, bz = frames[at + 3 * LANES], frames[at + 4 * LANES], frames[at + 5 * LANES]
    hx, hy, hz = frames[at + 6 * LANES], frames[at + 7 * LANES], frames[at + 8 * LANES]
    return by * hz - bz * hy, bz * hx - bx * hz, bx * hy - by * hx
