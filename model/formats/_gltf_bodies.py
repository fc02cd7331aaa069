"""The meshes of a glTF file in their own coordinates: primitives, morph targets, skins, Draco."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from model.errors import UnreadableMeshError
from model.formats._common import Limits, as_indices, no_faces, strip
from model.formats._gltf_buffers import Buffers
from model.formats._gltf_draco import Attributes
from model.formats._gltf_looks import Looks
from model.types import AnyArray, FloatArray, IntArray

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_MOST_INFLUENCES = 8  # sets of four joints a vertex


@dataclass(frozen=True, slots=True)
class Body:
    """One mesh of the file in its own coordinates; with a skin, (v, k) joints of each vertex and their weights."""

    vertices: FloatArray
    faces: IntArray
    joints: IntArray | None = None
    weights: FloatArray | None = None
    light: FloatArray | None = None  # (v, 4) linear colours, if any part has some
    places: AnyArray | None = None  # (v, 2) in pictures, with pictures, (f,), the number of that on each face
    pictures: IntArray | None = None

    def posed(self, matrices: FloatArray) -> FloatArray:
        """The vertices (v, 3) where the joints' matrices (j, 4, 4) take them."""
        assert self.joints is not None
        assert self.weights is not None
        if self.joints.size and int(self.joints.max()) >= len(matrices):
            raise UnreadableMeshError("The glTF file has a vertex that refers to a joint that does not exist.")
        result = np.zeros_like(self.vertices)
        for joints, weights in zip(self.joints.T, self.weights.T, strict=True):
            moved = np.einsum("vij,vj->vi", matrices[joints, :3, :3], self.vertices) + matrices[joints, :3, 3]
            result += weights[:, None] * moved
        return result


class Bodies:
    """Reads meshes as they are asked for."""

    def __init__(self, document: Any, buffers: Buffers, limits: Limits) -> None:
        self._json = document
        self._buffers = buffers
        self._limits = limits
        self._bodies: dict[tuple[int, tuple[float, ...]], Body] = {}
        self._without_surface = 0
        self.looks = Looks(document, buffers, limits.looks)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was passed over."""
        if not self._without_surface:
            return ()
        some = "One part" if self._without_surface == 1 else f"{self._without_surface} parts"
        return (f"{some} of the file made of points or lines had no surface and played no role.",)

    def get(self, index: int, weights: tuple[float, ...] | None) -> Body:
        """A mesh with the weights of its morph targets; None for the mesh's own."""
        mesh = self._json["meshes"][index]
        chosen = tuple(map(float, mesh.get("weights", ()))) if weights is None else weights
        key = index, chosen
        if key not in self._bodies:
            self._bodies[key] = self._read(mesh, chosen)
        return self._bodies[key]

    def _read(self, mesh: Any, weights: tuple[float, ...]) -> Body:
        """The triangles of a mesh; primitives that share all that moves their vertices share the vertices."""
        vertices: list[FloatArray] = []
        faces: list[IntArray] = [no_faces()]
        influences: list[tuple[IntArray, FloatArray] | None] = []
        light: list[FloatArray] = []
        places: list[AnyArray] = []
        pictures: list[IntArray] = []
        starts: dict[Any, tuple[int, int]] = {}
        total, made = 0, 0
        for primitive in mesh["primitives"]:
            mode = primitive.get("mode", _TRIANGLES)
            attributes = primitive["attributes"]
            if mode not in (_TRIANGLES, _STRIP, _FAN) or "POSITION" not in attributes:
                self._without_surface += 1
                continue
            stored = Attributes(primitive, self._json, self._buffers)
            mode = _TRIANGLES if stored.compressed else mode  # Draco stores strips as triangles too
            picture = self.looks.picture(primitive)
            key = (
                attributes["POSITION"],
                repr(primitive.get("targets")),
                repr(attributes.get("JOINTS_0")),
                repr(primitive.get("extensions")) if stored.compressed else None,
                primitive.get("material"),
                attributes.get("COLOR_0"),
                attributes.get(f"TEXCOORD_{self.looks.channel(primitive)}") if picture >= 0 else None,
            )
            if key not in starts or stored.compressed:
                self._limits.check(vertices=total + self._buffers.count(attributes["POSITION"]))
                stored.decode()
                points = stored.values("POSITION", 3).astype(np.float64)
                points = self._morphed(points, primitive.get("targets", ()), weights)
                starts[key] = total, len(points)
                vertices.append(points)
                influences.append(_influences(stored, len(points)))
                light.append(self.looks.light(primitive, stored, len(points)))
                if picture >= 0:
                    places.append(self.looks.places(primitive, stored, len(points)))
                else:
                    places.append(np.broadcast_to(np.zeros((1, 2)), (len(points), 2)))
                total += len(points)
            start, count = starts[key]
            if stored.indices is not None:
                indices = stored.indices
            elif "indices" in primitive:
                self._check_faces(primitive["indices"], mode, made)
                indices = as_indices(self._buffers.accessor(primitive["indices"], 1).reshape(-1))
            else:
                indices = np.arange(count, dtype=np.int32)
            if indices.size and (indices.min() < 0 or indices.max() >= count):
                raise UnreadableMeshError("The glTF file has a face that refers to a vertex that does not exist.")
            triangles = _triangles(indices, mode)
            faces.append(triangles + np.int32(start) if start else triangles)
            made += len(faces[-1])
            pictures.append(np.full(len(faces[-1]), picture, dtype=np.int32))
            self._limits.check(vertices=total, faces=made)
        tinted = _joined(light, 4)
        drawn = any(len(part) and part[0] >= 0 for part in pictures)
        return Body(
            _joined(vertices, 3),
            faces[1] if len(faces) == 2 else np.concatenate(faces),
            *_joined_influences(influences, [len(part) for part in vertices]),
            light=tinted if tinted.size and bool((tinted != 1.0).any()) else None,
            places=_joined(places, 2) if drawn else None,
            pictures=np.concatenate(pictures) if drawn else None,
        )

    def _morphed(self, points: FloatArray, targets: Any, weights: tuple[float, ...]) -> FloatArray:
        for target, weight in zip(targets, weights, strict=False):
            if weight != 0.0 and "POSITION" in target:
                points = points + weight * self._buffers.accessor(target["POSITION"], 3)
        return points

    def _check_faces(self, index: int, mode: int, made: int) -> None:
        """Primitives may share indices: a few bytes of JSON can ask for as many triangles as there are bytes."""
        count = self._buffers.count(index)
        self._limits.check(faces=made + (count // 3 if mode == _TRIANGLES else max(count - 2, 0)))


def _influences(attributes: Attributes, count: int) -> tuple[IntArray, FloatArray] | None:
    """Joints (v, k) and weights (v, k) that add up to one."""
    joints: list[AnyArray] = []
    weights: list[AnyArray] = []
    for number in range(_MOST_INFLUENCES):
        if f"JOINTS_{number}" not in attributes:
            break
        joints.append(as_indices(attributes.values(f"JOINTS_{number}", 4)))
        weights.append(attributes.values(f"WEIGHTS_{number}", 4).astype(np.float64))
    if not joints:
        return None
    which, much = np.concatenate(joints, axis=1), np.concatenate(weights, axis=1)
    if len(which) != count or len(much) != count or (which.size and which.min() < 0):
        raise UnreadableMeshError("The glTF file has joints that do not belong to its vertices.")
    sums = much.sum(axis=1)
    much[sums == 0.0, 0] = 1.0
    return which, much / np.where(sums == 0.0, 1.0, sums)[:, None]


def _joined(parts: list[FloatArray], width: int) -> FloatArray:
    """Arrays ``(n, width)`` in a row; one alone is not copied."""
    return parts[0] if len(parts) == 1 else np.concatenate([np.empty((0, width)), *parts])


def _joined_influences(
    parts: list[tuple[IntArray, FloatArray] | None], counts: list[int]
) -> tuple[IntArray, FloatArray] | tuple[None, None]:
    """Joints and weights of all vertices in a row; parts without any follow the first joint."""
    width = max((part[0].shape[1] for part in parts if part is not None), default=0)
    if width == 0:
        return None, None
    joints = np.zeros((sum(counts), width), dtype=np.int32)
    weights = np.zeros((sum(counts), width))
    start = 0
    for part, count in zip(parts, counts, strict=True):
        if part is None:
            weights[start : start + count, 0] = 1.0
        else:
            joints[start : start + count, : part[0].shape[1]] = part[0]
            weights[start : start + count, : part[1].shape[1]] = part[1]
        start += count
    return joints, weights


def _triangles(indices: IntArray, mode: int) -> IntArray:
    if mode == _TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    if mode == _STRIP:
        return strip(indices)
    if len(indices) < 3:
        return no_faces()
    return np.stack([np.full(len(indices) - 2, indices[0], np.int32), indices[1:-1], indices[2:]], axis=1)
