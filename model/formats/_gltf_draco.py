"""The attributes of the vertices of a glTF primitive, plain or compressed with Draco."""

import importlib
from typing import Any

import numpy as np

from model.errors import UnreadableMeshError
from model.formats._accessors import normalized
from model.formats._common import as_indices
from model.formats._gltf_buffers import Buffers
from model.types import AnyArray, IntArray

_draco: Any = importlib.import_module("DracoPy")  # it has no type information
_DRACO = "KHR_draco_mesh_compression"


class Attributes:
    """Reads the attributes of one primitive by their names in the file.

    Attributes:
        compressed: whether they, or some of them, are compressed with Draco.
        indices: corners of the triangles that are compressed with them, else None.
    """

    def __init__(self, primitive: Any, document: Any, buffers: Buffers) -> None:
        self._json = document
        self._buffers = buffers
        self._stored: dict[str, int] = primitive["attributes"]
        self._draco: Any = primitive.get("extensions", {}).get(_DRACO)
        self._decoded: dict[str, AnyArray] = {}
        self.compressed = self._draco is not None
        self.indices: IntArray | None = None

    def __contains__(self, name: str) -> bool:
        """Whether the primitive has an attribute."""
        return name in self._stored

    def values(self, name: str, width: int) -> AnyArray:
        """Values of an attribute (count, width), of the type they are stored as, or float64 where normalised.

        Raises:
            UnreadableMeshError: they are of another width, reach beyond their data, or cannot be decompressed.
        """
        if self.compressed and name in self._draco["attributes"]:
            return self._of_draco(name, width)
        return self._buffers.accessor(self._stored[name], width)

    def width(self, name: str) -> int:
        """Numbers of each value of a vector."""
        return int(self._json["accessors"][self._stored[name]]["type"][-1])

    def decode(self) -> None:
        """Decompress, if there is something to decompress.

        Raises:
            UnreadableMeshError: the data are damaged.
        """
        if not self.compressed or self.indices is not None:
            return
        data = self._buffers.bytes_of(self._draco["bufferView"])
        try:
            mesh = _draco.decode(data)
            by_number = {each["unique_id"]: np.array(each["data"]) for each in mesh.attributes}
            faces = as_indices(np.array(mesh.faces).reshape(-1))
        except MemoryError:
            raise
        except Exception as error:
            raise UnreadableMeshError("The glTF file has Draco data that cannot be decoded.") from error
        numbers: dict[str, int] = self._draco["attributes"]
        self._decoded = {name: by_number[number] for name, number in numbers.items() if number in by_number}
        self.indices = faces

    def _of_draco(self, name: str, width: int) -> AnyArray:
        self.decode()
        values = self._decoded.get(name)
        if values is None or values.ndim != 2 or values.shape[1] != width:
            raise UnreadableMeshError("The glTF file has Draco data without an attribute that it announces.")
        accessor = self._json["accessors"][self._stored[name]]
        return normalized(values, accessor)
