"""Colours and pictures: carried over to what is made of a mesh, and between the two ways to count light."""

import numpy as np

from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect
from model.meshes.mesh import Mesh
from model.meshes.texture import Texture
from model.types import AnyArray, BoolArray, ByteArray, FloatArray, IntArray

_PLACES = 1 << 16
"""Places in a picture that differ by less than one part of so many are one."""


def has_colors(mesh: Mesh) -> bool:
    """Whether the surface has more than one colour, or pictures on it."""
    if mesh.texture is not None or mesh.painted:
        return True
    return mesh.colors is not None and bool((mesh.colors != mesh.colors[mesh.faces[0, 0]]).any())


def with_looks_of(mesh: Mesh, vertices: FloatArray, faces: IntArray, mirrored: BoolArray, plane: FloatArray) -> Mesh:
    """A surface that was made of a mesh and of its mirror image, with the mesh's colours and pictures.

    Every corner gets what is at the place it came from on the face that its own face came from; so edges between
    colours stay sharp, and vertices where colours or parts of a picture meet become several.

    Args:
        mesh: what it was made of.
        vertices: ``(v, 3)`` of the new surface, in the mesh's coordinates.
        faces: ``(f, 3)``.
        mirrored: ``(f,)`` which of them come from the mirror image.
        plane: ``(n, d)`` ``(4,)`` that they were mirrored at.

    Raises:
        DegenerateMeshError: the surface has no extent or no area.
    """
    if mesh.colors is None and mesh.texture is None:
        return Mesh.checked(vertices, faces, source_format=mesh.source_format, units=mesh.units)
    corners = vertices[faces]
    corners[mirrored] = reflect(corners[mirrored].reshape(-1, 3), plane).reshape(-1, 3, 3)
    _, _, sources = SurfaceIndex(mesh.vertices, mesh.faces).closest(np.ascontiguousarray(corners.mean(axis=1)))
    source = mesh.faces[sources]
    weights = _barycentric(corners, mesh.vertices[source])
    keys: list[AnyArray] = [faces.reshape(-1).astype(np.int64)]
    colors = places = None
    if mesh.colors is not None:
        mixed = np.einsum("fck,fkh->fch", weights, mesh.colors[source].astype(np.float64))
        colors = np.clip(np.rint(mixed), 0, 255).astype(np.uint8).reshape(-1, 4)
        keys.append(colors.astype(np.int64) @ np.array([1 << 24, 1 << 16, 1 << 8, 1]))
    if mesh.texture is not None:
        mixed = np.einsum("fck,fkh->fch", weights, mesh.texture.places[source].astype(np.float64))
        places = mixed.astype(np.float32).reshape(-1, 2)
        keys += list(np.rint(mixed.reshape(-1, 2).T * _PLACES).astype(np.int64))
    first, inverse = distinct_rows(keys)
    return Mesh.checked(
        vertices[keys[0][first]],
        inverse.reshape(-1, 3).astype(np.int32),
        source_format=mesh.source_format,
        units=mesh.units,
        colors=None if colors is None else np.ascontiguousarray(colors[first]),
        texture=None
        if mesh.texture is None or places is None
        else Texture(places[first], mesh.texture.of_face[sources], mesh.texture.pictures),
    )


def distinct_rows(keys: list[AnyArray]) -> tuple[AnyArray, AnyArray]:
    """Of rows of integers, one array a column: the first of each kind, and of which kind every row is."""
    order = np.lexsort(keys[::-1])
    changes = np.zeros(len(order), dtype=np.bool_)
    for key in keys:
        changes[1:] |= key[order[1:]] != key[order[:-1]]
    kind = np.empty(len(order), dtype=np.int64)
    kind[order] = np.cumsum(changes)
    return order[np.flatnonzero(np.append(True, changes[1:]))], kind


def _barycentric(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Coordinates (f, c, 3) of points (f, c, 3) in triangles (f, 3 corners, 3), moved inside; a third where flat."""
    a, u, v = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    uu, uv, vv = (np.einsum("ij,ij->i", x, y)[:, None] for x, y in ((u, u), (u, v), (v, v)))
    to = points - a[:, None]
    pu, pv = np.einsum("fcx,fx->fc", to, u), np.einsum("fcx,fx->fc", to, v)
    det = uu * vv - uv * uv
    flat = ~(det > 1e-18 * uu * vv)
    det = np.where(flat, 1.0, det)
    second, third = (vv * pu - uv * pv) / det, (uu * pv - uv * pu) / det
    weights = np.stack([1.0 - second - third, second, third], axis=2)
    weights = np.clip(np.where(flat[..., None], 1.0 / 3.0, weights), 0.0, 1.0)
    return weights / weights.sum(axis=2, keepdims=True)


def to_linear(colors: ByteArray) -> AnyArray:
    """SRGB ``(v, 4)`` of 8 bits as linear light of 16 bits, as glTF counts it; opacity only scaled."""
    table = _linear(np.arange(256) / 255.0)
    result = np.empty(colors.shape, dtype=np.uint16)
    result[:, :3] = np.rint(65535.0 * table).astype(np.uint16)[colors[:, :3]]
    result[:, 3] = colors[:, 3].astype(np.uint16) * 257
    return result


def from_linear(light: FloatArray) -> ByteArray:
    """Linear light ``(v, 3 or 4)`` from 0 to 1 as sRGB ``(v, 4)`` of 8 bits."""
    if len(light) > 1 and (light == light[0]).all():  # of a material
        return np.repeat(from_linear(light[:1]), len(light), axis=0)
    light = np.clip(np.nan_to_num(light), 0.0, 1.0)
    result = np.full((len(light), 4), 255, dtype=np.uint8)
    rgb = light[:, :3]
    curved = np.where(rgb <= 0.0031308, 12.92 * rgb, 1.055 * np.maximum(rgb, 1e-9) ** (1.0 / 2.4) - 0.055)
    result[:, :3] = np.rint(255.0 * curved)
    if light.shape[1] == 4:
        result[:, 3] = np.rint(255.0 * light[:, 3])
    return result


def _linear(values: FloatArray) -> FloatArray:
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
