"""Binary glTF: the mesh, and beside it every plane as a translucent quad and every axis as a thin rod.

glTF has 32-bit coordinates. To keep the digits of a mesh far from its origin they are relative to the middle of its
box, and the node ``mesh`` moves them there: readers that apply the transforms of nodes, as all should, get input
coordinates.
"""

import json
import struct
from typing import Any

import numpy as np

from app.outputs.glb_pictures import Pictures, appendix, face_order, read_appendix
from app.outputs.mesh_file import Counts, MeshWriter, require_indices, require_numbers
from app.outputs.output_format import OutputFormat
from app.schemas import Axis, DetectResponse, Plane
from model.meshes.colors import to_linear
from model.meshes.texture import Texture
from model.types import AnyArray, ByteArray, FloatArray, IntArray

_U16, _U32, _F32 = 5123, 5125, 5126
_SIDES = 12
_MARGIN, _ROD_LENGTH, _ROD_RADIUS = 1.06, 1.2, 0.006
_ORDINARY = 1e-15, 1e15
_GREY = [0.72, 0.74, 0.77, 1.0]
_EXACT_PLANE, _SIMILAR_PLANE = [0.10, 0.45, 0.85, 0.28], [0.95, 0.55, 0.10, 0.28]
_EXACT_AXIS, _SIMILAR_AXIS = [0.80, 0.10, 0.20, 1.0], [0.95, 0.55, 0.10, 1.0]
_PICTURE_EXTENSIONS = {"image/webp": "EXT_texture_webp", "image/ktx2": "KHR_texture_basisu"}
_MATERIALS = (_GREY, _EXACT_PLANE, _SIMILAR_PLANE, _EXACT_AXIS, _SIMILAR_AXIS)


def _quad() -> tuple[FloatArray, IntArray]:
    """The square of side 2 in the x-y plane."""
    return np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def _rod() -> tuple[FloatArray, IntArray]:
    """The cylinder of radius 1 about z, from -1 to 1, closed."""
    angles = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    ring = np.stack([np.cos(angles), np.sin(angles), np.ones(_SIDES)], axis=1)
    points = np.concatenate([ring * [1, 1, -1], ring, [[0, 0, -1], [0, 0, 1]]])
    here, bottom, top = np.arange(_SIDES), 2 * _SIDES, 2 * _SIDES + 1
    there = (here + 1) % _SIDES
    low, high = np.full(_SIDES, bottom), np.full(_SIDES, top)
    faces = np.concatenate(
        [np.stack(corners, axis=1) for corners in (
            (here, there, there + _SIDES), (here, there + _SIDES, here + _SIDES),
            (low, there, here), (high, here + _SIDES, there + _SIDES),
        )]
    )  # fmt: skip
    return points, faces.astype(np.int32)


def _marks() -> tuple[bytes, list[dict[str, Any]], list[dict[str, Any]]]:
    """Quad and rod as bytes, with the views and accessors 2 to 5 that describe them, to stand before the body."""
    data, views, accessors = b"", list[dict[str, Any]](), list[dict[str, Any]]()
    for points, faces in (_quad(), _rod()):
        for values, kind in ((points.astype("<f4"), _F32), (faces.astype("<u2"), _U16)):
            views.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
            accessors.append(_accessor(len(views) - 1, values, kind))
            data += values.tobytes() + b"\0" * (-values.nbytes % 4)
    return data, views, accessors


def _accessor(view: int, values: AnyArray, kind: int) -> dict[str, Any]:
    if kind != _F32:
        return {"bufferView": view, "componentType": kind, "count": values.size, "type": "SCALAR"}
    low, high = values.min(axis=0).tolist(), values.max(axis=0).tolist()
    return {"bufferView": view, "componentType": kind, "count": len(values), "type": "VEC3", "min": low, "max": high}


def _placement(bounds: list[list[float]]) -> tuple[FloatArray, float]:
    """Where the node ``mesh`` moves its geometry, and by what it multiplies it: 1 unless 32 bits would not do."""
    low, high = np.array(bounds)
    extent = float((high - low).max())
    return (low + high) / 2.0, 1.0 if _ORDINARY[0] < extent < _ORDINARY[1] else extent


def _body(
    vertices: FloatArray,
    faces: IntArray,
    bounds: list[list[float]],
    colors: ByteArray | None = None,
    texture: Texture | None = None,
) -> bytes:
    origin, scale = _placement(bounds)
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):  # in vertices that no face uses
        points = ((vertices - origin) / scale).astype("<f4")
    points[~np.isfinite(points).all(axis=1)] = 0.0
    if texture is not None:
        faces = faces[face_order(texture)]
        colors = np.full((len(vertices), 4), 255, dtype=np.uint8) if colors is None else colors
    geometry = points.tobytes() + faces.astype("<u4").tobytes()
    if colors is not None:
        geometry += to_linear(colors).astype("<u2").tobytes()
    return geometry if texture is None else geometry + appendix(texture)


def _size(vertices: int, faces: int) -> int:
    return 12 * (vertices + faces)


def _head(counts: Counts, body: bytes) -> bytes:
    return _compose(counts, body, [], {})


def annotated_head(response: DetectResponse, body: bytes) -> bytes:
    """What stands before the body of a file with the mesh, its planes and its axes.

    Nodes are named ``mesh``, ``plane 0``, ``axis 0`` and so on, in the order of the response; their extras hold the
    numbers, those of ``mesh`` also the whole response as ``result``: one answer serves who needs both, as the viewer.

    Raises:
        BodyError: the body is not the geometry that the response tells of.
    """
    mesh = response.mesh
    nodes: list[dict[str, Any]] = []
    for index, plane in enumerate(response.planes):
        extras = plane.model_dump(exclude={"matrix"})
        matrix = _quad_matrix(plane, mesh.bounds)
        nodes.append({"name": f"plane {index}", "mesh": 1 if plane.exact else 2, "matrix": matrix, "extras": extras})
    for index, axis in enumerate(response.axes):
        extras = axis.model_dump(exclude={"matrix"})
        matrix = _rod_matrix(axis, response.frame.scale)
        nodes.append({"name": f"axis {index}", "mesh": 3 if axis.exact else 4, "matrix": matrix, "extras": extras})
    result = response.model_dump(mode="json", by_alias=True, exclude={"bop"} if response.bop is None else None)
    extras = {"point_group": response.point_group, "scale": response.frame.scale, "result": result}
    return _compose(Counts(mesh.vertices, mesh.faces, mesh.bounds), body, nodes, extras)


def _compose(counts: Counts, body: bytes, marks: list[dict[str, Any]], extras: dict[str, Any]) -> bytes:
    size = _size(counts.vertices, counts.faces)
    pictures: Pictures | None = None
    if len(body) not in (size, size + 8 * counts.vertices):
        pictures = read_appendix(body, size + 8 * counts.vertices, counts.vertices, counts.faces)
    colored = len(body) > size
    points = np.frombuffer(body, "<f4", 3 * counts.vertices).reshape(-1, 3)
    faces = np.frombuffer(body, "<u4", 3 * counts.faces, 12 * counts.vertices)
    require_numbers(points)
    require_indices(faces, counts.vertices)
    data, views, accessors = _marks() if marks else (b"", [], [])
    origin, scale = _placement(counts.bounds)
    matrix = np.diag([scale, scale, scale, 1.0])
    matrix[:3, 3] = origin
    first = len(accessors)
    for values, kind in ((points, _F32), (faces, _U32)):
        views.append({"buffer": 0, "byteOffset": len(data) + (12 * counts.vertices if kind == _U32 else 0)})
        views[-1]["byteLength"] = values.nbytes
        accessors.append(_accessor(len(views) - 1, values, kind))
    attributes = {"POSITION": first}
    if colored:
        views.append({"buffer": 0, "byteOffset": len(data) + size, "byteLength": 8 * counts.vertices})
        accessors.append(
            {
                "bufferView": len(views) - 1,
                "componentType": _U16,
                "normalized": True,
                "count": counts.vertices,
                "type": "VEC4",
            }
        )
        attributes["COLOR_0"] = first + 2
    shapes = [(0, 1), (0, 2), (2, 3), (2, 4)] if marks else []
    # Colours of vertices are multiplied by that of the material: it is white where there are some.
    materials = [_material(colour) for colour in ([1.0] * 4 if colored else _GREY, *(_MATERIALS[1:] if marks else ()))]
    own = [{"attributes": attributes, "indices": first + 1, "material": 0}]
    images: dict[str, Any] = {}
    if pictures is not None:
        own, images = _with_pictures(pictures, counts.vertices, len(data), own[0], views, accessors, materials)
    nodes = [{"name": "mesh", "mesh": 0, "matrix": _columns(matrix), "extras": extras}, *marks]
    document = {
        "asset": {"version": "2.0", "generator": "prsnet"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": [
            {"primitives": own},
            *(
                {"primitives": [{"attributes": {"POSITION": place}, "indices": place + 1, "material": material}]}
                for place, material in shapes
            ),
        ],
        "materials": materials,
        **images,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data) + len(body)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    total = 12 + 8 + len(text) + 8 + len(data) + len(body)
    return b"".join(
        [
            struct.pack("<4sII", b"glTF", 2, total),
            struct.pack("<I4s", len(text), b"JSON"), text,
            struct.pack("<I4s", len(data) + len(body), b"BIN\0"), data,
        ]
    )  # fmt: skip


def _with_pictures(
    pictures: Pictures,
    vertices: int,
    before: int,
    whole: dict[str, Any],
    views: list[dict[str, Any]],
    accessors: list[dict[str, Any]],
    materials: list[dict[str, Any]],
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """The primitives of a mesh with pictures, one for each, and the lists of images and textures.

    ``whole`` is the primitive of all triangles; what the parts refer to is appended to the lists that are given. The
    body stands behind so many bytes ``before`` it.
    """
    views.append({"buffer": 0, "byteOffset": before + pictures.places, "byteLength": 8 * vertices})
    accessors.append({"bufferView": len(views) - 1, "componentType": _F32, "count": vertices, "type": "VEC2"})
    attributes = {**whole["attributes"], "TEXCOORD_0": len(accessors) - 1}
    triangles = accessors[int(whole["indices"])]
    first_view, first_material = len(views), len(materials)
    for index, laid in enumerate(pictures.laid):
        views.append({"buffer": 0, "byteOffset": before + laid.start, "byteLength": laid.length})
        materials.append(_material([1.0] * 4))
        materials[-1]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": index}
    parts, at = list[dict[str, Any]](), 0
    groups = [(pictures.plain, 0), *((each.faces, first_material + k) for k, each in enumerate(pictures.laid))]
    for faces, material in groups:
        if faces:
            accessors.append({**triangles, "byteOffset": 12 * at, "count": 3 * faces})
            parts.append({"attributes": attributes, "indices": len(accessors) - 1, "material": material})
        at += faces
    images = [{"bufferView": first_view + k, "mimeType": each.media_type} for k, each in enumerate(pictures.laid)]
    needed = [_PICTURE_EXTENSIONS.get(each.media_type) for each in pictures.laid]
    textures = [
        {"source": k} if extension is None else {"extensions": {extension: {"source": k}}}
        for k, extension in enumerate(needed)
    ]
    lists: dict[str, Any] = {"images": images, "textures": textures}
    if extensions := sorted({extension for extension in needed if extension}):
        lists |= {"extensionsUsed": extensions, "extensionsRequired": extensions}
    return parts, lists


def _material(colour: list[float]) -> dict[str, Any]:
    surface = {"baseColorFactor": colour, "metallicFactor": 0.0, "roughnessFactor": 0.9}
    return {
        "pbrMetallicRoughness": surface, "doubleSided": True, "alphaMode": "OPAQUE" if colour[3] == 1.0 else "BLEND",
    }  # fmt: skip


def _quad_matrix(plane: Plane, bounds: list[list[float]]) -> list[float]:
    """Takes the unit quad to a rectangle on the plane that the shadow of the mesh's box just fits in."""
    normal, point = np.array(plane.normal), np.array(plane.point)
    first, second = _across(normal)
    corners = np.array([[bounds[i][0], bounds[j][1], bounds[k][2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    shadow = (corners - point) @ np.stack([first, second], axis=1)
    low, high = shadow.min(axis=0), shadow.max(axis=0)
    half = _MARGIN * (high - low) / 2.0
    half = np.maximum(half, 0.02 * half.max())  # of a flat mesh something shall be seen
    middle = point + (low + high) / 2.0 @ np.stack([first, second])
    return _columns(_frame(half[0] * first, half[1] * second, half.max() * normal, middle))


def _rod_matrix(axis: Axis, scale: float) -> list[float]:
    """Takes the unit rod to one through the mesh's centre, longer than the mesh."""
    direction = np.array(axis.direction)
    first, second = _across(direction)
    radius, length = _ROD_RADIUS * scale, _ROD_LENGTH * scale / 2.0
    return _columns(_frame(radius * first, radius * second, length * direction, np.array(axis.point)))


def _across(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two directions that make a right-handed frame with ``normal``, one as near to a coordinate axis as can be."""
    nearest = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first: FloatArray = nearest - (nearest @ normal) * normal
    first = first / np.linalg.norm(first)
    second: FloatArray = np.cross(normal, first)
    return first, second


def _frame(x: FloatArray, y: FloatArray, z: FloatArray, origin: FloatArray) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3] = np.stack([x, y, z, origin], axis=1)
    return matrix


def _columns(matrix: FloatArray) -> list[float]:
    """As glTF wants it: column after column."""
    return [float(value) for value in matrix.T.ravel()]


WRITER = MeshWriter(_body, _head, _size, annotated_head=annotated_head)
FORMAT = OutputFormat(
    "glb",
    "model/gltf-binary",
    "`format=glb`: the mesh, each plane as a translucent quad, each axis as a thin rod; "
    "nodes `mesh`, `plane 0`, `axis 0`, and so on.",
    mesh=WRITER,
)
