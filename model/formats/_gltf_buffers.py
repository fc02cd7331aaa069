"""Where the numbers of a glTF file are: buffers, views of them, plain or compressed, and accessors."""

import base64
import binascii
from typing import Any
from urllib.parse import unquote_to_bytes

from model.errors import UnreadableMeshError
from model.formats._accessors import read_accessor
from model.formats._common import Resources
from model.formats._foreign import foreign_content
from model.formats._meshopt import decode_view
from model.types import AnyArray

_MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")


class Buffers:
    """Reads the accessors of one document."""

    def __init__(self, document: Any, binary: bytes | None, resources: Resources) -> None:
        self._json = document
        self._binary = binary
        self._resources = resources
        self._buffers: dict[int, bytes] = {}
        self._decoded: dict[int, bytes] = {}

    def accessor(self, index: int, width: int) -> AnyArray:
        """Values of an accessor (count, width), of the type they are stored as, or float64 where normalised.

        Raises:
            UnreadableMeshError: it is of another width, or reaches beyond its data.
        """
        if index < 0:
            raise UnreadableMeshError("The glTF file has a negative index.")
        return read_accessor(self._json, index, width, self._view)

    def count(self, index: int) -> int:
        """How many values an accessor announces."""
        return max(int(self._json["accessors"][index]["count"]), 0)

    def bytes_of(self, index: int) -> bytes:
        """The bytes of a buffer view."""
        buffer, start, end, _ = self._view(index)
        return buffer[start:end]

    def image(self, index: int) -> bytes | None:
        """The file of an image; None where it is not at hand."""
        image = self._json["images"][index]
        if "bufferView" in image:
            return self.bytes_of(image["bufferView"])
        uri = image["uri"]
        return _embedded(uri) if uri[:5].lower() == "data:" else self._resources(uri)

    def _view(self, index: int) -> tuple[bytes, int, int, int]:
        """Buffer, first byte, end, and stride (0 if packed) of a buffer view."""
        view = self._json["bufferViews"][index]
        extensions = view.get("extensions", {})
        for name in _MESHOPT:
            if name in extensions:
                if index not in self._decoded:
                    self._decoded[index] = decode_view(extensions[name], self._slice(extensions[name]))
                decoded = self._decoded[index]
                return decoded, 0, len(decoded), int(extensions[name]["byteStride"])
        buffer = self._buffer(view["buffer"])
        start, end = _range(view, buffer)
        return buffer, start, end, int(view.get("byteStride", 0))

    def _slice(self, view: Any) -> bytes:
        buffer = self._buffer(view["buffer"])
        start, end = _range(view, buffer)
        return buffer[start:end]

    def _buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            uri = self._json["buffers"][index].get("uri")
            if uri is None:
                if self._binary is None or index != 0:
                    raise UnreadableMeshError("The glTF file has a buffer without content.")
                self._buffers[index] = self._binary
            else:
                self._buffers[index] = self._content(uri)
        return self._buffers[index]

    def _content(self, uri: str) -> bytes:
        """What a URI stands for: the data it holds, or the file of that name that the caller has."""
        if uri[:5].lower() == "data:":
            return _embedded(uri)
        found = self._resources(uri)
        if found is None:
            raise UnreadableMeshError(
                "The glTF file keeps its numbers in another file, which is not there. Keep the .bin file beside it, or "
                "send both in one upload: curl -F file=@chair.gltf -F file=@chair.bin URL; or export it as GLB."
            )
        if words := foreign_content(found[:1024]):
            raise UnreadableMeshError(f"The file beside the glTF file, which should hold its numbers, is {words}")
        return found


def _range(view: Any, buffer: bytes) -> tuple[int, int]:
    start = int(view.get("byteOffset", 0))
    end = start + int(view["byteLength"])
    if start < 0 or end < start or end > len(buffer):
        raise UnreadableMeshError("The glTF file has a buffer view beyond its buffer.")
    return start, end


def _embedded(uri: str) -> bytes:
    """Content of a data URI."""
    head, _, body = uri.partition(",")
    if not head.lower().endswith(";base64"):
        return unquote_to_bytes(body)
    try:
        return base64.b64decode(body)
    except binascii.Error as error:
        raise UnreadableMeshError("The glTF file has an embedded buffer that is no base64.") from error
