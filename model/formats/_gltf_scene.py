"""The scene of a glTF file: which meshes are shown, how often, and where."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from model.errors import UnreadableMeshError
from model.formats._common import Limits
from model.formats._gltf_buffers import Buffers
from model.types import FloatArray

_INSTANCES = "EXT_mesh_gpu_instancing"
_VISIBILITY = "KHR_node_visibility"


@dataclass(frozen=True, slots=True)
class Placed:
    """A mesh of the scene.

    Attributes:
        mesh: its number.
        matrices: (k, 4, 4) one for each time it is placed, for column vectors.
        weights: of its morph targets; None for those of the mesh.
        skin: number of the skin that moves its vertices instead of the matrices.
    """

    mesh: int
    matrices: FloatArray
    weights: tuple[float, ...] | None
    skin: int | None


class Scene:
    """The default scene of a document; ``placed`` in the order of its nodes."""

    def __init__(self, document: Any, buffers: Buffers, limits: Limits) -> None:
        self._json = document
        self._buffers = buffers
        self._limits = limits
        self._nodes: list[Any] = document.get("nodes", [])
        self._world: dict[int, FloatArray] = {}
        self._parents: dict[int, int] = {}
        self._counted = 0
        self.warnings: tuple[str, ...] = ()
        for index, node in enumerate(self._nodes):
            for child in node.get("children", []):
                if child in self._parents or child == index:
                    raise UnreadableMeshError("The glTF file has a node with more than one parent.")
                self._parents[child] = index
        self.placed = self._walk()

    def _walk(self) -> list[Placed]:
        """Every node may be reached once only."""
        scenes = self._json.get("scenes", [])
        if scenes:
            roots = scenes[self._json.get("scene", 0)].get("nodes", [])
        else:
            roots = [index for index in range(len(self._nodes)) if index not in self._parents]
        if len(scenes) > 1:
            self.warnings += (f"The file has {len(scenes)} scenes; only the default one was read.",)
        found: list[Placed] = []
        visited: set[int] = set()
        waiting: list[tuple[int, FloatArray, bool]] = [(root, np.eye(4), True) for root in reversed(roots)]
        while waiting:
            index, parent, visible = waiting.pop()
            if index in visited or index < 0:
                raise UnreadableMeshError("The glTF file has a node with more than one parent.")
            visited.add(index)
            self._count_nodes(1)
            node = self._nodes[index]
            matrix = self._world[index] = parent @ _local_matrix(node)
            visible = visible and node.get("extensions", {}).get(_VISIBILITY, {}).get("visible", True) is not False
            if "mesh" in node and visible:
                found.append(self._place(node, matrix))
            waiting += [(child, matrix, visible) for child in reversed(node.get("children", []))]
        return found

    def _count_nodes(self, count: int) -> None:
        self._counted += count
        self._limits.check(nodes=self._counted)

    def _place(self, node: Any, matrix: FloatArray) -> Placed:
        matrices = matrix[None]
        instances = node.get("extensions", {}).get(_INSTANCES)
        if instances is not None:
            matrices = matrix @ self._instance_matrices(instances["attributes"])
        weights = node.get("weights")
        mesh = int(node["mesh"])
        if mesh < 0:
            raise UnreadableMeshError("The glTF file has a negative index.")
        return Placed(
            mesh,
            matrices,
            None if weights is None else tuple(map(float, weights)),
            int(node["skin"]) if "skin" in node else None,
        )

    def _instance_matrices(self, attributes: dict[str, int]) -> FloatArray:
        """(k, 4, 4) from the accessors of `EXT_mesh_gpu_instancing`."""
        named = {name: attributes[name] for name in ("TRANSLATION", "ROTATION", "SCALE") if name in attributes}
        counts = {self._buffers.count(index) for index in attributes.values()}
        if len(counts) != 1:
            raise UnreadableMeshError("The glTF file has instances of which it does not say how many there are.")
        count = counts.pop()
        self._count_nodes(count)
        matrices = np.tile(np.eye(4), (count, 1, 1))
        if "ROTATION" in named:
            matrices[:, :3, :3] = _rotations(self._buffers.accessor(named["ROTATION"], 4).astype(np.float64))
        if "SCALE" in named:
            matrices[:, :3, :3] *= self._buffers.accessor(named["SCALE"], 3).astype(np.float64)[:, None, :]
        if "TRANSLATION" in named:
            matrices[:, :3, 3] = self._buffers.accessor(named["TRANSLATION"], 3)
        return matrices

    def joint_matrices(self, index: int) -> FloatArray:
        """(joints, 4, 4) from a mesh's bind pose to the world, of one skin."""
        skin = self._json["skins"][index]
        joints = np.stack([self._world_matrix(joint) for joint in skin["joints"]])
        if "inverseBindMatrices" in skin:
            inverse = self._buffers.accessor(skin["inverseBindMatrices"], 16).astype(np.float64)[: len(joints)]
            joints = joints[: len(inverse)] @ inverse.reshape(-1, 4, 4).transpose(0, 2, 1)
        return joints

    def _world_matrix(self, index: int) -> FloatArray:
        """Also of nodes that the scene does not reach."""
        path: list[int] = []
        at: int | None = index
        while at is not None and at not in self._world:
            if len(path) > len(self._nodes):
                raise UnreadableMeshError("The glTF file has a node that contains itself.")
            path.append(at)
            at = self._parents.get(at)
        matrix = np.eye(4) if at is None else self._world[at]
        for node in reversed(path):
            matrix = self._world[node] = matrix @ _local_matrix(self._nodes[node])
        return matrix


def _rotations(quaternions: FloatArray) -> FloatArray:
    """(k, 3, 3) of quaternions (k, 4) as x, y, z, w, of any length."""
    x, y, z, w = quaternions.T
    length = x * x + y * y + z * z + w * w
    s = np.where(length > 0, 2.0 / np.where(length > 0, length, 1.0), 0.0)
    rows = [
        [1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
        [s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)],
        [s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def _local_matrix(node: Any) -> FloatArray:
    """(4, 4) transform of a node, from its matrix or from translation, rotation and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    if "rotation" in node:
        matrix[:3, :3] = _rotations(np.array(node["rotation"], dtype=np.float64).reshape(1, 4))[0]
    if "scale" in node:
        matrix[:3, :3] *= np.array(node["scale"], dtype=np.float64).reshape(3)
    if "translation" in node:
        matrix[:3, 3] = np.array(node["translation"], dtype=np.float64).reshape(3)
    return matrix
