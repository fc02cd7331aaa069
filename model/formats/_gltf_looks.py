"""The looks of a glTF file: base colours, colours of vertices, and pictures with their places."""

from typing import Any

import numpy as np

from model.errors import UnreadableMeshError
from model.formats._gltf_buffers import Buffers
from model.formats._gltf_draco import Attributes
from model.meshes.texture import MOST_PICTURES, Picture, picture
from model.types import AnyArray, FloatArray

_TRANSFORM = "KHR_texture_transform"
_SOURCES = ("EXT_texture_webp", "KHR_texture_basisu")
_BROKEN = (
    StopIteration,
    KeyError,
    IndexError,
    TypeError,
    ValueError,
    AttributeError,
    OverflowError,
    UnreadableMeshError,
)
"""A shape with broken looks is a shape all the same."""


class Looks:
    """Reads what the primitives of one document look like; pictures only where they are ``wanted``.

    Attributes:
        pictures: those that were met.
        painted: whether some were met that were not wanted.
        lost: how many were wanted and not there.
    """

    def __init__(self, document: Any, buffers: Buffers, wanted: bool) -> None:
        self._json = document
        self._buffers = buffers
        self._wanted = wanted
        self._numbers: dict[int, int] = {}
        self.pictures: list[Picture] = []
        self.painted = False
        self.lost = 0

    def light(self, primitive: Any, attributes: Attributes, count: int) -> FloatArray:
        """Linear colours (v, 4) of a primitive: those of its vertices times that of its material; else white."""
        light = np.ones((1, 4))
        try:
            if "COLOR_0" in attributes:
                width = attributes.width("COLOR_0")
                values = attributes.values("COLOR_0", width).astype(np.float64)
                if len(values) == count and width in (3, 4):
                    light = np.ones((count, 4))
                    light[:, :width] = values
            factor = self._surface(primitive).get("baseColorFactor", [1.0] * 4)
            light = light * np.array(factor, dtype=np.float64).reshape(4)
        except _BROKEN:
            light = np.ones((1, 4))
        return np.broadcast_to(light, (count, 4))

    def picture(self, primitive: Any) -> int:
        """Number of the picture on a primitive, -1 for none."""
        try:
            used = self._surface(primitive).get("baseColorTexture")
            if used is None:
                return -1
            self.painted = self.painted or not self._wanted
            return self._number(self._source(used["index"])) if self._wanted else -1
        except _BROKEN:
            self.lost += self._wanted
            return -1

    def channel(self, primitive: Any) -> int:
        """Which set of places its picture is laid by."""
        try:
            used = self._surface(primitive)["baseColorTexture"]
            return int(used.get("extensions", {}).get(_TRANSFORM, {}).get("texCoord", used.get("texCoord", 0)))
        except _BROKEN:
            return 0

    def places(self, primitive: Any, attributes: Attributes, count: int) -> AnyArray:
        """Where its vertices are in its picture (v, 2), moved as its material says; zeros where that is not told."""
        try:
            values = attributes.values(f"TEXCOORD_{self.channel(primitive)}", 2)
            if values.shape != (count, 2):
                return np.zeros((count, 2))
            used = self._surface(primitive)["baseColorTexture"]
            return _moved(values.astype(np.float64), used.get("extensions", {}).get(_TRANSFORM, {}))
        except _BROKEN:
            return np.zeros((count, 2))

    def _surface(self, primitive: Any) -> Any:
        if "material" not in primitive:
            return {}
        return self._json["materials"][primitive["material"]].get("pbrMetallicRoughness", {})

    def _source(self, index: int) -> int:
        """The image of a texture: the one for everybody, or else that of an extension."""
        texture = self._json["textures"][index]
        if "source" in texture:
            return int(texture["source"])
        return next(int(texture["extensions"][name]["source"]) for name in _SOURCES if name in texture["extensions"])

    def _number(self, index: int) -> int:
        """The number among `pictures` of an image of the document."""
        if index not in self._numbers:
            found = picture(self._buffers.image(index)) if len(self.pictures) < MOST_PICTURES else None
            self._numbers[index] = -1 if found is None else len(self.pictures)
            self.lost += found is None
            self.pictures += [] if found is None else [found]
        return self._numbers[index]


def _moved(places: FloatArray, transform: Any) -> FloatArray:
    """Places (v, 2) after `KHR_texture_transform`: scaled, turned, shifted."""
    scale = np.array(transform.get("scale", [1.0, 1.0]), dtype=np.float64).reshape(2)
    shift = np.array(transform.get("offset", [0.0, 0.0]), dtype=np.float64).reshape(2)
    angle = float(transform.get("rotation", 0.0))
    sine, cosine = np.sin(angle), np.cos(angle)
    u, v = (places * scale).T
    return np.stack([cosine * u + sine * v, -sine * u + cosine * v], axis=1) + shift
