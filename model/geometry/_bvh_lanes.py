"""Distances to all children of a node, and to all triangles of a leaf, in vector instructions: see ``model._lanes``."""

from typing import Any

from model._jit import intrinsic
from model._lanes import INDEX, TRUE, ZERO, Memory, same_in_all
from model.geometry._bvh import FANOUT, LANES


@intrinsic
def near_boxes(typing: Any, boxes: Any, at: Any, x: Any, y: Any, z: Any, enough: Any, squared: Any) -> Any:
    """``near_boxes(boxes, at, x, y, z, enough, squared)``: the children of a node that are nearer than ``enough``.

    ``squared`` ``(FANOUT,)`` is filled with squared distances to their boxes, infinite for absent children; returned is
    a number with a bit for each that is below ``enough``.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kinds, start = signature.args, arguments[1]
        corners = Memory(context, builder, (kinds[0], arguments[0]), start, FANOUT)
        total = None
        for axis in range(3):
            place = same_in_all(builder, arguments[2 + axis], FANOUT)
            gap = (corners.row(axis) - place).max(place - corners.row(3 + axis)).max(0.0)
            total = gap * gap if total is None else total + gap * gap
        assert total is not None
        Memory(context, builder, (kinds[6], arguments[6]), ZERO, FANOUT).store(total)
        return (total < same_in_all(builder, arguments[5], FANOUT)).bits()

    return INDEX(boxes, INDEX, x, y, z, enough, squared), generate


@intrinsic
def near_triangles(typing: Any, frames: Any, at: Any, x: Any, y: Any, z: Any, enough: Any, squared: Any) -> Any:
    """``near_triangles(frames, at, x, y, z, enough, squared)``: the triangles of a leaf nearer than ``enough``.

    ``squared`` ``(LANES,)`` is filled with squared distances; returned is a number with a bit for each that is below
    ``enough``.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kinds = signature.args
        row = Memory(context, builder, (kinds[0], arguments[0]), arguments[1], LANES).row
        px, py, pz = (same_in_all(builder, arguments[2 + axis], LANES) - row(axis) for axis in range(3))
        bx, by, bz, hx, hy, hz = (row(k) for k in range(3, 9))
        base, cx, cy, left_share, right_share = (row(k) for k in range(9, 14))
        u = px * bx + py * by + pz * bz
        v = px * hx + py * hy + pz * hz
        w = px * (by * hz - bz * hy) + py * (bz * hx - bx * hz) + pz * (bx * hy - by * hx)
        du = (-u).max(u - base).max(0.0)
        below = du * du + v * v
        t = ((u * cx + v * cy) * left_share).max(0.0).min(1.0)
        left_u, left_v = u - t * cx, v - t * cy
        left = left_u * left_u + left_v * left_v
        ru, rx = u - base, cx - base
        t = ((ru * rx + v * cy) * right_share).max(0.0).min(1.0)
        right_u, right_v = ru - t * rx, v - t * cy
        right = right_u * right_u + right_v * right_v
        inside = (cy > 0.0).where((u * cy - v * cx).min(v * rx - ru * cy), -1.0)
        above = (inside >= 0.0).where(0.0, left.min(right))
        total = (v < 0.0).where(below, above) + w * w
        Memory(context, builder, (kinds[6], arguments[6]), ZERO, LANES).store(total)
        return (total < same_in_all(builder, arguments[5], LANES)).bits()

    return INDEX(frames, INDEX, x, y, z, enough, squared), generate


@intrinsic
def lowest(typing: Any, bits: Any) -> Any:
    """``lowest(bits)``: the number of the lowest bit that is set."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], TRUE)

    return INDEX(INDEX), generate
