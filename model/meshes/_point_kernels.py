"""Neighbours, triangles and signs of point clouds: the loops behind `model.meshes.points`."""

import numpy as np

from model._jit import jit, jit_allocating
from model.types import AnyArray, FloatArray, IntArray

_WIDEST = 2.0
"""A triangle's circumradius, in units of the spacing at the corner that asks for it."""

_STEEPEST = 1.5
"""A neighbour higher above the tangent plane than this many times its distance in the plane is another sheet's."""


@jit
def find_nearest(
    points: FloatArray,
    places: AnyArray,
    order: AnyArray,
    starts: AnyArray,
    side: int,
    neighbours: AnyArray,
    squared: FloatArray,
) -> None:
    """Fill the nearest other points of each point, by rings of cells about its own; there must be enough points."""
    count, wanted = neighbours.shape
    for point in range(count):
        x, y, z = points[point, 0], points[point, 1], points[point, 2]
        found = 0
        for ring in range(side):
            reach = ring / side
            if (
                found == wanted
                and squared[point, wanted - 1] <= (reach - 1.0 / side) * (reach - 1.0 / side)
                and ring > 1
            ):
                break
            for i in range(max(0, places[point, 0] - ring), min(side, places[point, 0] + ring + 1)):
                for j in range(max(0, places[point, 1] - ring), min(side, places[point, 1] + ring + 1)):
                    # Of the inner rows of a ring only the two ends are new.
                    inner = abs(i - places[point, 0]) < ring and abs(j - places[point, 1]) < ring
                    step = 2 * ring if inner else 1
                    for k in range(places[point, 2] - ring, places[point, 2] + ring + 1, max(step, 1)):
                        if k < 0 or k >= side:
                            continue
                        cell = (i * side + j) * side + k
                        for row in range(starts[cell], starts[cell + 1]):
                            other = order[row]
                            if other == point:
                                continue
                            dx, dy, dz = points[other, 0] - x, points[other, 1] - y, points[other, 2] - z
                            distance = dx * dx + dy * dy + dz * dz
                            if found == wanted and distance >= squared[point, wanted - 1]:
                                continue
                            at = found if found < wanted else wanted - 1
                            while at > 0 and squared[point, at - 1] > distance:
                                squared[point, at] = squared[point, at - 1]
                                neighbours[point, at] = neighbours[point, at - 1]
                                at -= 1
                            squared[point, at] = distance
                            neighbours[point, at] = other
                            found = min(found + 1, wanted)


@jit_allocating
def join_stars(
    points: FloatArray, normals: FloatArray, neighbours: AnyArray, spacing: FloatArray, faces: IntArray
) -> int:
    """Fill the triangles about every point in its tangent plane; the number of them.

    Inverted in a circle about the point, its Delaunay neighbours are the corners of the convex hull of all neighbours
    and of the point itself, which stands for infinity; the circle through the point and two neighbours becomes the line
    through these.
    """
    count, wanted = neighbours.shape
    u, v = np.empty(wanted + 1), np.empty(wanted + 1)
    names = np.empty(wanted + 1, dtype=np.int64)
    written = 0
    for point in range(count):
        nx, ny, nz = normals[point, 0], normals[point, 1], normals[point, 2]
        # Two directions across the normal.
        if abs(nx) < 0.6:
            ax, ay, az = 0.0, nz, -ny
        else:
            ax, ay, az = -nz, 0.0, nx
        length = np.sqrt(ax * ax + ay * ay + az * az)
        ax, ay, az = ax / length, ay / length, az / length
        bx, by, bz = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
        used, start = 0, 0
        for k in range(wanted):
            other = neighbours[point, k]
            dx = points[other, 0] - points[point, 0]
            dy = points[other, 1] - points[point, 1]
            dz = points[other, 2] - points[point, 2]
            s, t, h = dx * ax + dy * ay + dz * az, dx * bx + dy * by + dz * bz, dx * nx + dy * ny + dz * nz
            flat = s * s + t * t
            if flat <= 1e-12 * spacing[point] ** 2 or h * h > _STEEPEST * _STEEPEST * flat:
                continue
            u[used], v[used], names[used] = s / flat, t / flat, other
            if used == 0 or u[used] ** 2 + v[used] ** 2 > u[start] ** 2 + v[start] ** 2:
                start = used
            used += 1
        if used < 2:
            continue
        u[used], v[used], names[used] = 0.0, 0.0, -1
        used += 1
        now = start
        for _ in range(used):
            ahead = 0 if now != 0 else 1
            for j in range(used):
                if j == now:
                    continue
                turn = (u[ahead] - u[now]) * (v[j] - v[now]) - (v[ahead] - v[now]) * (u[j] - u[now])
                if turn < 0.0:
                    ahead = j
            if names[now] >= 0 and names[ahead] >= 0:
                du, dv = u[ahead] - u[now], v[ahead] - v[now]
                gap = abs(u[now] * dv - v[now] * du)
                # The circumradius is half of the inverse of the line's distance.
                if gap > 0.0 and du * du + dv * dv <= (2.0 * _WIDEST * spacing[point] * gap) ** 2:
                    faces[written, 0], faces[written, 1], faces[written, 2] = point, names[now], names[ahead]
                    written += 1
            now = ahead
            if now == start:
                break
    return written


@jit_allocating
def spread_signs(first: AnyArray, second: AnyArray, agreement: FloatArray, signs: AnyArray, parts: AnyArray) -> None:
    """Signs ``(n,)`` that make the normals at both ends of edges agree, where edges contradict each other the first.

    ``parts`` ``(n,)`` names the connected parts; signs of different parts have nothing to do with each other.
    """
    count = signs.shape[0]
    for point in range(count):
        parts[point], signs[point] = point, 1
    path = np.empty(count, dtype=np.int64)
    for edge in range(first.shape[0]):
        roots = np.empty(2, dtype=np.int64)
        ends = np.empty(2, dtype=np.int64)
        for side in range(2):
            at = first[edge] if side == 0 else second[edge]
            roots[side], ends[side] = _root(at, parts, signs, path)
        if roots[0] != roots[1]:
            want = 1 if agreement[edge] >= 0.0 else -1
            parts[roots[1]] = roots[0]
            signs[roots[1]] = want * ends[0] * ends[1]
    for point in range(count):
        parts[point], signs[point] = _root(point, parts, signs, path)


@jit
def _root(point: int, parts: AnyArray, signs: AnyArray, path: AnyArray) -> tuple[int, int]:
    """The root of a point's tree, and the point's sign against it; the way there is shortened.

    ``signs`` hold each point's sign against its parent; a root's own is 1.
    """
    length = 0
    at = point
    while parts[at] != at:
        path[length] = at
        length += 1
        at = parts[at]
    sign = 1
    for step in range(length - 1, -1, -1):
        sign *= int(signs[path[step]])
        parts[path[step]], signs[path[step]] = at, sign
    return at, sign
