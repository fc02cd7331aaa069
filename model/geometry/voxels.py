"""Exact surface voxelization, the network's input (the paper, Section 3.1: a binary grid of 32 x 32 x 32)."""

import numpy as np

from model._jit import jit, jit_allocating, kernel_array
from model.types import BoolArray, FloatArray, IntArray

# In voxel edges: touching within this distance counts as touching. It covers the rounding of the tests themselves, so
# that a voxel is never missed, and is far below any difference a mesh file can express.
_TOLERANCE = 1e-12
_SMALLEST_DIVISOR = 1e-290  # its inverse is still finite


def voxelize(vertices_unit: FloatArray, faces: IntArray, resolution: int = 32) -> BoolArray:
    """Mark every voxel that the surface touches; there are no sampling holes.

    A voxel is occupied if and only if a closed triangle meets the closed box of the voxel, decided by the separating
    axis test for triangle and box (Akenine-Moller 2001). Triangles without area count as the segment or point they are.

    Args:
        vertices_unit: (v, 3) finite coordinates in the unit frame. Parts outside the cube [-0.5, 0.5]^3 are ignored.
        faces: (f, 3) vertex indices.
        resolution: voxels R along each edge of the cube.

    Returns:
        (R, R, R) bool, indexed [x, y, z]; voxel [i, j, k] spans (i / R - 0.5, (i + 1) / R - 0.5) in x, and so on.
    """
    if resolution < 1:
        raise ValueError("the resolution must be at least 1")
    occupied = np.zeros((resolution, resolution, resolution), dtype=np.bool_)
    _mark_triangles(
        kernel_array(vertices_unit, np.float64), kernel_array(faces, np.int32), resolution, occupied.ravel()
    )
    return occupied


@jit_allocating
def _mark_triangles(vertices: FloatArray, faces: IntArray, resolution: int, occupied: BoolArray) -> None:
    """Mark the voxels of every triangle in the flattened grid.

    For an axis a, the voxel with index vector i overlaps the triangle in projection iff L <= a.i <= H, with L and H
    constant for the triangle. With two indices given this bounds the third, so that no voxel is visited in vain. The
    coordinates are called u, v, w, with w the dominant direction of the normal: only few voxels lie along it.
    """
    # Only scalars are handed to other kernels: passing arrays would cost more than the tests themselves.
    corners = np.empty((3, 3))  # [axis, corner] in grid coordinates: one voxel is a unit cube
    first = np.empty(3, dtype=np.int64)
    last = np.empty(3, dtype=np.int64)
    row_w = np.empty((3, 4))  # edge x v: bounds w from u
    column_w = np.empty((3, 4))  # edge x u: bounds w from v
    row_v = np.empty((3, 4))  # edge x w: bounds v from u
    for face in range(faces.shape[0]):
        reach = 0.0
        visible, inside = True, True
        single = 0
        for axis in range(3):
            a = (vertices[faces[face, 0], axis] + 0.5) * resolution
            b = (vertices[faces[face, 1], axis] + 0.5) * resolution
            c = (vertices[faces[face, 2], axis] + 0.5) * resolution
            corners[axis, 0], corners[axis, 1], corners[axis, 2] = a, b, c
            low, high = min(a, b, c), max(a, b, c)
            reach = max(reach, -low, high)
            # The clamps come before the conversion to integers, which is undefined for large numbers.
            first[axis] = int(min(max(np.ceil(low - _TOLERANCE) - 1.0, 0.0), float(resolution)))
            last[axis] = int(max(min(np.floor(high + _TOLERANCE), resolution - 1.0), -1.0))
            visible = visible and first[axis] <= last[axis]
            inside = inside and low >= 0.0 and high <= resolution
            single += first[axis] == last[axis]
        if not visible:
            continue
        if _all_marked(first[0], first[1], first[2], last[0], last[1], last[2], resolution, occupied):
            continue
        if single >= 2 and inside:
            # The triangle is connected and stays in one row of voxels: it touches each of them.
            for i in range(first[0], last[0] + 1):
                for j in range(first[1], last[1] + 1):
                    for k in range(first[2], last[2] + 1):
                        occupied[(i * resolution + j) * resolution + k] = True
            continue
        tolerance = _TOLERANCE + 1e-15 * reach
        nx, ny, nz = _normal(
            corners[0, 0], corners[1, 0], corners[2, 0],
            corners[0, 1], corners[1, 1], corners[2, 1],
            corners[0, 2], corners[1, 2], corners[2, 2],
        )  # fmt: skip
        if abs(nx) >= abs(ny) and abs(nx) >= abs(nz):
            u, v, w, nu, nv, nw = 1, 2, 0, ny, nz, nx
        elif abs(ny) >= abs(nz):
            u, v, w, nu, nv, nw = 2, 0, 1, nz, nx, ny
        else:
            u, v, w, nu, nv, nw = 0, 1, 2, nx, ny, nz
        if nw < 0.0:
            nu, nv, nw = -nu, -nv, -nw
        d0 = nu * corners[u, 0] + nv * corners[v, 0] + nw * corners[w, 0]
        d1 = nu * corners[u, 1] + nv * corners[v, 1] + nw * corners[w, 1]
        d2 = nu * corners[u, 2] + nv * corners[v, 2] + nw * corners[w, 2]
        size = abs(nu) + abs(nv) + nw
        plane_inverse, plane_low, plane_high = 0.0, -np.inf, np.inf
        if nw > _SMALLEST_DIVISOR:
            plane_inverse = 1.0 / nw
            plane_low = min(d0, d1, d2) - tolerance * size - max(nu, 0.0) - max(nv, 0.0) - nw
            plane_high = max(d0, d1, d2) + tolerance * size - min(nu, 0.0) - min(nv, 0.0)
        for edge in range(3):
            end = (edge + 1) % 3
            far = (edge + 2) % 3
            pu, pv, pw = corners[u, edge], corners[v, edge], corners[w, edge]
            eu, ev, ew = corners[u, end] - pu, corners[v, end] - pv, corners[w, end] - pw
            fu, fv, fw = corners[u, far], corners[v, far], corners[w, far]
            row_w[edge] = _constraint(pu, pw, eu, ew, fu, fw, tolerance, resolution)
            column_w[edge] = _constraint(pv, pw, ev, ew, fv, fw, tolerance, resolution)
            row_v[edge] = _constraint(pu, pv, eu, ev, fu, fv, tolerance, resolution)
        stride_u, stride_v, stride_w = resolution ** (2 - u), resolution ** (2 - v), resolution ** (2 - w)
        for i in range(first[u], last[u] + 1):
            row_low, row_high = float(first[v]), float(last[v])
            low, high = float(first[w]), float(last[w])
            for edge in range(3):
                p, inverse, lower, upper = row_v[edge, 0], row_v[edge, 1], row_v[edge, 2], row_v[edge, 3]
                row_low, row_high = _clip(p * i, inverse, lower, upper, row_low, row_high)
                p, inverse, lower, upper = row_w[edge, 0], row_w[edge, 1], row_w[edge, 2], row_w[edge, 3]
                low, high = _clip(p * i, inverse, lower, upper, low, high)
            if row_low > row_high or low > high:
                continue
            for j in range(int(row_low), int(row_high) + 1):
                start, stop = _clip(nu * i + nv * j, plane_inverse, plane_low, plane_high, low, high)
                for edge in range(3):
                    p, inverse = column_w[edge, 0], column_w[edge, 1]
                    lower, upper = column_w[edge, 2], column_w[edge, 3]
                    start, stop = _clip(p * j, inverse, lower, upper, start, stop)
                if start <= stop:
                    base = i * stride_u + j * stride_v
                    for k in range(int(start), int(stop) + 1):
                        occupied[base + k * stride_w] = True


@jit
def _all_marked(x0: int, y0: int, z0: int, x1: int, y1: int, z1: int, resolution: int, occupied: BoolArray) -> bool:
    """Whether every voxel of a small index box is occupied already; False without looking for larger boxes."""
    if (x1 - x0 + 1) * (y1 - y0 + 1) * (z1 - z0 + 1) > 12:
        return False
    for i in range(x0, x1 + 1):
        for j in range(y0, y1 + 1):
            for k in range(z0, z1 + 1):
                if not occupied[(i * resolution + j) * resolution + k]:
                    return False
    return True


@jit
def _normal(
    ax: float, ay: float, az: float, bx: float, by: float, bz: float, cx: float, cy: float, cz: float
) -> tuple[float, float, float]:
    """The cross product of the two shorter edges, which loses the fewest digits on slivers."""
    px, py, pz = bx - ax, by - ay, bz - az
    qx, qy, qz = cx - bx, cy - by, cz - bz
    rx, ry, rz = ax - cx, ay - cy, az - cz
    p, q, r = px * px + py * py + pz * pz, qx * qx + qy * qy + qz * qz, rx * rx + ry * ry + rz * rz
    if p >= q and p >= r:
        px, py, pz, qx, qy, qz = qx, qy, qz, rx, ry, rz
    elif q >= r:
        qx, qy, qz, px, py, pz = px, py, pz, rx, ry, rz
    return py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx


@jit
def _constraint(
    px: float, py: float, ex: float, ey: float, fx: float, fy: float, tolerance: float, resolution: int
) -> tuple[float, float, float, float]:
    """The separating axis across an edge in the plane of two coordinates x and y, to be solved for y.

    (px, py) is the start of the edge, (ex, ey) its vector, (fx, fy) the third corner. Returns p, 1 / r, L, H for the
    axis (p, r) with r >= 0.
    """
    p, r = -ey, ex
    if r < 0.0:
        p, r = -p, -r
    near, far = p * px + r * py, p * fx + r * fy
    size = abs(p) + r
    low = min(near, far) - tolerance * size - max(p, 0.0) - r
    high = max(near, far) + tolerance * size - min(p, 0.0)
    if r > 1e-14 * size and r > _SMALLEST_DIVISOR:
        return p, 1.0 / r, low, high
    return p, 0.0, low - r * resolution, high  # y hardly matters: keep the bound for every y in the grid


@jit
def _clip(value: float, inverse: float, lower: float, upper: float, low: float, high: float) -> tuple[float, float]:
    """Narrow the integers ``low..high`` to the k with L <= value + r k <= H; an empty range has low > high."""
    if inverse == 0.0:
        if value < lower or value > upper:
            return 1.0, 0.0
        return low, high
    return max(low, np.ceil((lower - value) * inverse)), min(high, np.floor((upper - value) * inverse))
