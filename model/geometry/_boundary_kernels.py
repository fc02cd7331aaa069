"""Which images of surface points lie where nobody saw the surface: see `model.geometry.open_boundary`.

Everything is in the axes of the tree.
"""

import numpy as np

from model._jit import jit, jit_allocating
from model.geometry._bvh import LANES, Scratch, Tree, scratch
from model.geometry._bvh_frames import closest_on
from model.geometry._bvh_query import nearest
from model.geometry._bvh_within import leaf_within
from model.geometry._operation_kernels import image_of
from model.types import BoolArray, ByteArray, FloatArray, IntArray

MOST_UNSEEN = 200
"""So many unseen places that other operations led to are compared with."""

SEEN, BEYOND, BEHIND = 0, 1, 2
"""Whether what a sample should meet at its image was seen, or why not: it lies beyond an open edge, or behind the near
side of what is there."""


@jit_allocating
def find_missing(
    samples: FloatArray,
    sample_normals: FloatArray,
    fixed: FloatArray,
    linear: FloatArray,
    near: float,
    plausible: float,
    share: float,
    one_sided: bool,
    sideways: float,
    on_edge: float,
    probe: float,
    closed: float,
    normals: FloatArray,
    open_edge: BoolArray,
    open_vertex: BoolArray,
    tree: Tree,
    squared: FloatArray,
    unseen: ByteArray,
) -> None:
    """Fill ``squared`` ``(k, n)`` with squared distances of all images, and ``unseen`` ``(k, n)``: `SEEN` or why not.

    Lengths come as they are compared: ``near``, ``plausible``, ``on_edge`` and ``closed`` squared.
    """
    paper = scratch()
    images, turned = np.empty((len(squared), len(samples), 3)), np.empty(3)
    believed = np.zeros(len(squared), dtype=np.bool_)
    lanes = np.empty(len(samples), dtype=np.int64)
    away, outward, place = np.empty(3), np.empty(3), np.empty(3)
    seed = 0
    needed = int(share * (len(samples) - 1)) + 1
    for k in range(squared.shape[0]):
        fitting, image = 0, images[k]
        for i in range(squared.shape[1]):
            image_of(samples[i], fixed[k], linear[k], image[i])
            squared[k, i], lanes[i] = nearest(
                image[i, 0],
                image[i, 1],
                image[i, 2],
                seed,
                np.inf,
                tree,
                paper,
            )
            seed = lanes[i] // LANES
            fitting += squared[k, i] <= plausible
        believed[k] = fitting >= needed
        for i in range(squared.shape[1]):
            unseen[k, i] = SEEN
            if not believed[k] or squared[k, i] <= near:
                continue
            lane = lanes[i]
            owner = tree.owners[lane]
            x, y, z = closest_on(image[i, 0], image[i, 1], image[i, 2], lane, tree)
            place[0], place[1], place[2] = x, y, z
            height, facing = 0.0, 0.0
            for a in range(3):
                away[a] = image[i, a] - place[a]
                height += away[a] * normals[owner, a]
                turned[a] = 0.0
                for b in range(3):
                    turned[a] += linear[k, a, b] * sample_normals[i, b]
                facing += turned[a] * normals[owner, a]
            distance = np.sqrt(squared[k, i])
            if height < -0.5 * distance and (one_sided or facing < 0.5):
                unseen[k, i] = BEHIND
                continue
            length = 0.0
            for a in range(3):
                outward[a] = away[a] - height * normals[owner, a]
                length += outward[a] * outward[a]
            length = np.sqrt(length)
            if length <= sideways * distance and height >= 0.0:
                continue
            if not _on_open_edge(place, tree.vertices, tree.faces[owner], open_edge[owner], open_vertex, on_edge):
                continue
            for a in range(3):
                outward[a] /= max(length, 1e-300)
            if not _goes_on(
                place,
                outward,
                normals[owner],
                probe,
                closed,
                int(lane // LANES),
                turned,
                tree,
                paper,
            ):
                unseen[k, i] = BEYOND
    _spread(images, squared, near, believed, unseen)


@jit_allocating
def _spread(images: FloatArray, squared: FloatArray, near: float, believed: BoolArray, unseen: ByteArray) -> None:
    """What lies nearer to a place that nobody saw than to any surface was not seen either.

    From deep within a hole the nearest surface may be another one than its rim. The unseen places are the same for all
    operations: some that any of those ``believed`` ``(k,)`` led to serve the others as well.
    """
    count, samples = 0, squared.shape[1]
    for k in range(squared.shape[0]):
        for i in range(samples):
            count += believed[k] and unseen[k, i] != SEEN
    stride = max(1, -(-count // MOST_UNSEEN))
    places, reasons = np.empty((-(-count // stride), 3)), np.empty(-(-count // stride), dtype=np.uint8)
    count = 0
    for k in range(squared.shape[0]):
        for i in range(samples):
            if believed[k] and unseen[k, i] != SEEN:
                if count % stride == 0:
                    places[count // stride] = images[k, i]
                    reasons[count // stride] = unseen[k, i]
                count += 1
    reached, left = np.empty(samples, dtype=np.int32), np.empty(samples, dtype=np.int32)
    for k in range(squared.shape[0]):
        if not believed[k] or count == 0:
            continue
        top, asked = 0, 0
        for i in range(samples):
            if unseen[k, i] != SEEN:
                reached[top] = i
                top += 1
            elif squared[k, i] > near:
                left[asked] = i
                asked += 1
        for place in range(len(places)):
            here = asked
            asked = _reach(places[place], reasons[place], images[k], squared[k], unseen[k], left, asked, reached, top)
            top += here - asked
        while top > 0 and asked > 0:
            top -= 1
            place, here = reached[top], asked
            reason = unseen[k, place]
            asked = _reach(images[k, place], reason, images[k], squared[k], unseen[k], left, asked, reached, top)
            top += here - asked


@jit
def _reach(
    place: FloatArray,
    reason: int,
    images: FloatArray,
    squared: FloatArray,
    unseen: ByteArray,
    left: IntArray,
    asked: int,
    reached: IntArray,
    top: int,
) -> int:
    """Mark images that are nearer to a place than to the surface, and note them from ``top`` on.

    Of the first ``asked`` that are ``left`` the others stay, in their order: how many are returned.
    """
    kept = 0
    for which in range(asked):
        i = left[which]
        gap = 0.0
        for a in range(3):
            gap += (images[i, a] - place[a]) * (images[i, a] - place[a])
        if gap < squared[i]:
            unseen[i] = reason
            reached[top] = i
            top += 1
        else:
            left[kept] = i
            kept += 1
    return kept


@jit
def _on_open_edge(
    place: FloatArray,
    vertices: FloatArray,
    face: IntArray,
    open_edge: BoolArray,
    open_vertex: BoolArray,
    near: float,
) -> bool:
    """Whether a point of a face lies on one of its open edges, or on a corner where one ends."""
    for k in range(3):
        here, there = face[k], face[(k + 1) % 3]
        if not (open_edge[k] or open_vertex[here]):
            continue
        dot, square, at_corner = 0.0, 0.0, 0.0
        for a in range(3):
            along = vertices[there, a] - vertices[here, a]
            arm = place[a] - vertices[here, a]
            dot += along * arm
            square += along * along
            at_corner += arm * arm
        if open_vertex[here] and at_corner < near:
            return True
        if open_edge[k]:
            share = min(max(dot / max(square, 1e-300), 0.0), 1.0)
            gap = 0.0
            for a in range(3):
                foot = vertices[here, a] + share * (vertices[there, a] - vertices[here, a])
                gap += (place[a] - foot) * (place[a] - foot)
            if gap < near:
                return True
    return False


@jit
def _goes_on(
    place: FloatArray,
    outward: FloatArray,
    normal: FloatArray,
    probe: float,
    closed: float,
    seed: int,
    across: FloatArray,
    tree: Tree,
    paper: Scratch,
) -> bool:
    """Whether the surface goes on beyond a point of an open edge: straight on, folded, or as a face across.

    Faces that meet without sharing vertices leave open edges that are none. Where one of them stands across, it
    does so on both sides of the point; a rim that crosses a fold has it on one. ``across`` ``(3,)`` is scratch.
    """
    across[0] = outward[1] * normal[2] - outward[2] * normal[1]
    across[1] = outward[2] * normal[0] - outward[0] * normal[2]
    across[2] = outward[0] * normal[1] - outward[1] * normal[0]
    diagonal = 0.5**0.5
    before = False
    for number in range(7):
        if number < 3:  # straight on, or folded up or down by 45 degrees
            turn = 0.0 if number == 0 else (1.0 if number == 1 else -1.0)
            ahead, up, beside = (1.0, 0.0, 0.0) if number == 0 else (diagonal, turn * diagonal, 0.0)
        else:  # across, above and below, on one side and the other
            ahead, up, beside = 0.0, 1.0 if number < 5 else -1.0, 4.0 if number % 2 == 1 else -4.0
        found = (
            leaf_within(
                place[0] + probe * (ahead * outward[0] + up * normal[0] + beside * across[0]),
                place[1] + probe * (ahead * outward[1] + up * normal[1] + beside * across[1]),
                place[2] + probe * (ahead * outward[2] + up * normal[2] + beside * across[2]),
                seed,
                closed,
                tree,
                paper,
            )
            >= 0
        )
        if number < 3 and found:
            return True
        if number in (4, 6) and before and found:
            return True
        before = found
    return False
