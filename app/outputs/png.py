"""A picture of a mesh with its planes as translucent discs and its axes as rods, drawn without a display."""

import struct
import zlib
from typing import Literal, TypeAlias

import numpy as np

from app.outputs.rendering import Scene, camera
from app.schemas import DetectResponse
from model.formats import FORMATS
from model.types import FloatArray, IntArray

Up: TypeAlias = Literal["y", "z"]

_MESH = np.array([0.86, 0.88, 0.92])
_EXACT_PLANE, _SIMILAR_PLANE = np.array([0.10, 0.45, 0.85]), np.array([0.95, 0.55, 0.10])
_EXACT_AXIS, _SIMILAR_AXIS = np.array([0.80, 0.10, 0.20]), np.array([0.85, 0.45, 0.05])
_AZIMUTH, _ELEVATION = -55.0, 22.0
_Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def usual_up(response: DetectResponse) -> Up:
    """The axis that points up by the habits of a file's format."""
    format = FORMATS.get(response.mesh.format or "")
    return format.up if format is not None else "y"


def picture(
    response: DetectResponse, vertices: FloatArray, faces: IntArray, *, pixels: int = 800, up: Up | None = None
) -> bytes:
    """A square PNG of what a response says about a mesh ``(v, 3)``, ``(f, 3)``; ``up`` is guessed by the format."""
    upright = _Y_UP if (up or usual_up(response)) == "y" else np.eye(3)
    centre, half = np.array(response.frame.center), 0.5 * response.frame.scale
    # About the centre: the digits of a mesh far from its origin are kept.
    scene = Scene(camera(_AZIMUTH, _ELEVATION), np.zeros(3), 1.12 * half)
    scene.add_triangles((vertices[faces] - centre) @ upright.T, _MESH)
    alpha = 0.45 / max(1.0, len(response.planes)) ** 0.7
    for plane in response.planes:
        colour = _EXACT_PLANE if plane.exact else _SIMILAR_PLANE
        scene.add_disc(upright @ (np.array(plane.point) - centre), upright @ plane.normal, 0.98 * half, colour, alpha)
    for axis in response.axes:
        colour = _EXACT_AXIS if axis.exact else _SIMILAR_AXIS
        middle, direction = np.array(axis.point) - centre, np.array(axis.direction)
        ends = np.stack([middle + side * 1.1 * half * direction for side in (-1.0, 1.0)])
        scene.add_tube(ends @ upright.T, (0.02 if axis.continuous else 0.012) * half, colour)
    return encode(np.rint(255.0 * scene.image(pixels)).astype(np.uint8).tobytes(), pixels, pixels)


def encode(rows: bytes, width: int, height: int) -> bytes:
    """A PNG file of 8-bit RGB rows."""
    stride = 3 * width
    lines = b"".join(b"\0" + rows[at : at + stride] for at in range(0, stride * height, stride))
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(lines, 9)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )
