"""One shape shown to every method, and what is kept of each answer: the record that reports are made of."""

import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from model.geometry.frames import UnitFrame
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect, rotation_matrix
from model.meshes.mesh import Mesh
from model.types import FloatArray, IntArray
from training.evaluation.corruptions import CorruptedShape, corrupt
from training.evaluation.matching import (
    Found,
    FoundAxis,
    angle_between,
    clear,
    clear_axes_found,
    clear_planes_found,
    ground_truth_error,
    match,
    matched_once,
    nearest_clear_plane,
)
from training.evaluation.method import Answer, Method
from training.evaluation.recorded import RecordedPlanes
from training.oracle.truth import Truth

ROUGH_ANGLE, ROUGH_DISTANCE = 5.0, 0.05
"""Degrees, and distance in the unit frame, within which a true plane or axis counts as roughly met."""

_JUDGE_SAMPLES, _FRESH_SAMPLES = 1500, 2000
_JUDGE_SEED, _FRESH_SEED = 7919, 104729
_GONE = 0.02
"""Unit frame: surface farther than this from the mesh as shown is missing. Noise and decimation stay below."""

_FILLED = 0.02
"""Unit frame of the intact shape: surface is there, or was completed rightly, to within 2 % of its diameter."""

_SWEEP = 12
"""Angles a continuous axis is judged at; the worst counts."""


def judge(
    mesh: Mesh,
    truth: Truth,
    damage: str,
    seed: tuple[int, int],
    methods: Mapping[str, Method],
    recorded: Mapping[str, RecordedPlanes] | None = None,
) -> dict[str, Any]:
    """Show one shape to every method.

    Args:
        mesh: the intact shape.
        truth: what is known of it, in its unit frame.
        damage: one of `training.evaluation.corruptions.DAMAGES`.
        seed: of the evaluation, and the index of the shape.
        methods: by name.
        recorded: planes of other programs for the intact shape, by their name.

    Returns:
        ``faces`` (of the file), ``shown_faces``, ``clear_planes``, ``clear_axes`` (numbers of), ``truth_planes``,
        ``shown_sde`` (errors of the clear planes on the mesh as it is shown), ``completion_possible`` (the error of the
        missing part mirrored in the best clear plane; None where nothing is missing), ``surface_before`` and
        ``surface_possible`` (shares of the intact surface that is shown, and that is there once the best clear plane
        has mirrored it), ``listed`` (true planes and axes of any error) and ``methods``: a record each, see `_record`.
    """
    shown = corrupt(mesh.vertices, mesh.faces, damage, *seed)
    intact_frame = UnitFrame.of(mesh.vertices, mesh.faces)
    whole = _Judge(intact_frame.to_unit(mesh.vertices), mesh.faces, _JUDGE_SAMPLES, _JUDGE_SEED)
    frame = UnitFrame.of(shown.vertices, shown.faces)
    seen = _Judge(frame.to_unit(shown.vertices), shown.faces, _FRESH_SAMPLES, _FRESH_SEED)
    certain = clear(truth)
    hole = _missing_part(whole.samples, shown, frame, seen)
    mirrored = _Mirrored(whole, seen, shown, frame)
    shape = Mesh.checked(shown.vertices, shown.faces)
    records: dict[str, Any] = {}
    for name, method in methods.items():
        started = time.process_time()
        answer = method(shape, seed)
        spent = 1e3 * (time.process_time() - started) + answer.reused_ms
        found = answer.found
        fresh = [seen.plane(frame.plane_to_unit(plane)) for plane in found.planes]
        fresh += [seen.axis(axis.direction, frame.to_unit(axis.point), axis.order) for axis in found.axes]
        records[name] = _record(answer, _to_unit(shown, found), truth, certain, whole) | {
            "title": method.title,
            "fresh_sde": fresh,
            "completion": _least(hole(plane) for plane in found.planes),
            "surface_after": mirrored.there(found.planes[:1]),
            "surface_all": mirrored.there(found.planes),
            "surface_wrong": mirrored.wrong(found.planes[:1]),
            "surface_all_wrong": mirrored.wrong(found.planes),
            "ms": spent,
        }
    for name, given in (recorded or {}).items():
        planes = np.array([intact_frame.plane_to_unit(plane) for plane in given.planes]).reshape(-1, 4)
        record = _record(Answer(Found(planes)), Found(planes), truth, certain, whole)
        title = f"{name}, recorded"
        records[f"recorded {name}"] = record | {
            "title": title, "fresh_sde": record["plane_sde"], "ms": given.milliseconds
        }  # fmt: skip
    true_planes = shown.similarity.planes_to_shown(certain.planes)
    return {
        "faces": len(mesh.faces),
        "shown_faces": len(shown.faces),
        "clear_planes": len(certain.planes),
        "clear_axes": len(certain.axes),
        "truth_planes": len(truth.planes),
        "shown_sde": [seen.plane(frame.plane_to_unit(plane)) for plane in true_planes],
        "completion_possible": _least(hole(plane) for plane in true_planes),
        "surface_before": mirrored.there(true_planes[:0]),
        "surface_possible": max([mirrored.there(plane[None]) for plane in true_planes], default=None),
        "listed": len(truth.planes) + len(truth.axes),
        "methods": records,
    }


def _to_unit(shown: CorruptedShape, found: Found) -> Found:
    """An answer for the shape as shown, in the unit frame of the intact one."""
    similarity = shown.similarity
    axes = [
        FoundAxis(similarity.directions_to_unit(axis.direction), similarity.points_to_unit(axis.point), axis.order)
        for axis in found.axes
    ]
    return Found(similarity.planes_to_unit(found.planes), axes)


def _record(answer: Answer, found: Found, truth: Truth, certain: Truth, whole: "_Judge") -> dict[str, Any]:
    """What is kept of an answer; ``found`` in the unit frame of the intact shape, errors on the intact shape.

    ``gte`` and ``gte_angle`` (degrees) are those of the best plane by SDE against the closest clear one, ``nearest``;
    ``gte_closest`` is the smallest GTE of any plane, ``closest_angle`` the smallest angle. None where there is no clear
    plane or nothing was returned.
    """
    to_clear, to_all = match(certain, found), match(truth, found)
    errors = [whole.plane(plane) for plane in found.planes]
    gte = gte_angle = gte_closest = closest_angle = None
    best = found.planes[int(np.argmin(errors))] if errors else None
    nearest = None if best is None else nearest_clear_plane(truth, best)
    if best is not None and nearest is not None:
        gte = float(np.square(nearest - best).sum())
        gte_angle = angle_between(best[:3], nearest[:3])
        gte_closest = min(error for plane in found.planes if (error := ground_truth_error(truth, plane)) is not None)
        closest_angle = min(
            angle_between(plane[:3], near[:3])
            for plane in found.planes
            if (near := nearest_clear_plane(truth, plane)) is not None
        )
    return {
        "planes": found.planes.tolist(),
        "axes": [
            {"direction": axis.direction.tolist(), "point": axis.point.tolist(), "order": axis.order}
            for axis in found.axes
        ],
        "plane_sde": errors,
        "nearest": None if nearest is None else nearest.tolist(),
        "gte": gte,
        "gte_angle": gte_angle,
        "gte_closest": gte_closest,
        "closest_angle": closest_angle,
        "planes_found": to_clear.planes.tolist(),
        "planes_roughly": clear_planes_found(truth, found.planes, ROUGH_ANGLE, ROUGH_DISTANCE),
        "angles": to_clear.angles[to_clear.planes].tolist(),
        "axes_found": to_clear.axes.tolist(),
        "axes_roughly": clear_axes_found(truth, found.axes, ROUGH_ANGLE, ROUGH_DISTANCE),
        "orders_found": to_clear.orders.tolist(),
        "matches": matched_once(certain, found, to_clear.true_planes),
        "dominant": bool(to_clear.true_planes[:1].any()),
        "unlisted": int((~to_all.true_planes).sum() + (~to_all.true_axes).sum()),
        "stages": answer.stages,
        "point_group": answer.point_group,
        "exact": answer.exact,
    }


def _least(errors: Iterable[float | None]) -> float | None:
    return min((error for error in errors if error is not None), default=None)


def _missing_part(
    samples: FloatArray, shown: CorruptedShape, frame: UnitFrame, seen: "_Judge"
) -> Callable[[FloatArray], float | None]:
    """How well a plane of the mesh as shown completes it: a function from the plane to an error.

    The paper's application: what is missing is taken from the mirror image of what is there. A point of the missing
    part is as far from that image as its own image is from what is there: the error is the root of the mean square of
    these distances, unit frame of the mesh as shown. None where nothing is missing.
    """
    places = frame.to_unit(shown.similarity.to_shown(samples))
    gone = places[seen.surface.squared_distances(places) > _GONE**2]

    def error(plane: FloatArray) -> float | None:
        if not len(gone):
            return None
        return float(np.sqrt(seen.surface.mean_squared_distance(reflect(gone, frame.plane_to_unit(plane)))))

    return error


class _Mirrored:
    """What a mesh as shown becomes when all of it is mirrored in a plane: how much of the intact one, how much besides.

    Planes ``(k, 4)`` are given in the coordinates shown; what is shown is mirrored in each of them, once.
    """

    def __init__(self, whole: "_Judge", seen: "_Judge", shown: CorruptedShape, frame: UnitFrame) -> None:
        self._whole, self._seen, self._similarity, self._frame = whole, seen, shown.similarity, frame
        self._places = frame.to_unit(shown.similarity.to_shown(whole.samples))
        self._near = (_FILLED * shown.similarity.scale / frame.scale) ** 2
        self._shown = seen.surface.squared_distances(self._places) <= self._near

    def there(self, planes: FloatArray) -> float:
        """The share of the intact surface within `_FILLED` of what is shown or of a mirror image of it."""
        filled = self._shown
        for plane in planes:
            images = reflect(self._places, self._frame.plane_to_unit(plane))
            filled = filled | (self._seen.surface.squared_distances(images) <= self._near)
        return float(filled.mean())

    def wrong(self, planes: FloatArray) -> float:
        """The share of the mirror images that is farther than `_FILLED` from the intact surface; 0 of no plane."""
        shares: list[float] = []
        for plane in planes:
            images = self._frame.to_input(reflect(self._seen.samples, self._frame.plane_to_unit(plane)))
            away = self._whole.surface.squared_distances(self._similarity.points_to_unit(images))
            shares.append(float((away > _FILLED**2).mean()))
        return float(np.mean(shares)) if shares else 0.0


class _Judge:
    """Symmetry errors on samples of one surface, in its unit frame."""

    def __init__(self, vertices: FloatArray, faces: IntArray, count: int, seed: int) -> None:
        self.surface = SurfaceIndex(vertices, faces, work=np.inf)
        self.samples, _ = sample_surface(vertices, faces, count, seed=seed)

    def plane(self, plane: FloatArray) -> float:
        return self.surface.mean_squared_distance(reflect(self.samples, plane))

    def axis(self, direction: FloatArray, point: FloatArray, order: int | None) -> float:
        """SDE of the rotation by 2π/``order``; of a continuous axis the largest over some angles."""
        if order is not None:
            angles = [2.0 * np.pi / order]
        else:
            angles = [2.0 * np.pi * (step - 0.38) / (2 * _SWEEP + 1) for step in range(1, _SWEEP + 1)]
        arms = self.samples - point
        turned = (arms @ rotation_matrix(direction, angle).T + point for angle in angles)
        return max(self.surface.mean_squared_distance(points) for points in turned)
