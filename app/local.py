"""The library: the same answers as the service gives, computed in this process.

>>> from app import detect
>>> detect("chair.obj").planes[0].matrix
"""

import functools
import os
import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app import detection
from app.completion import CompleteOptions, complete_mesh
from app.detection import to_response
from app.edit_schemas import Completion, Half, Sector
from app.editing import AlignOptions, HalveOptions, SectorOptions, align_mesh, halve_mesh, sector_mesh
from app.outputs.fem import half_with_lines, sector_with_lines
from app.outputs.mesh_file import MeshWriter
from app.outputs.registry import MESH_WRITERS
from app.planes import PlaneLike, plane_numbers
from app.queries import AlignQuery, CompleteQuery, DetectQuery, HalveQuery, SectorQuery
from app.refusals import require
from app.schemas import DetectResponse, Include, LevelName, Mode
from model.formats.conversion import MeshLike, as_mesh
from model.meshes.mesh import Mesh
from model.meshes.texture import Texture
from model.types import ByteArray, FloatArray, IntArray

if TYPE_CHECKING:
    import trimesh

    from app.detection import SymmetryDetector


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Geometry:
    """A mesh made of another: ``vertices`` ``(v, 3)``, ``faces`` ``(f, 3)``, and its looks if there are any.

    ``colors`` are ``(v, 4)`` uint8 sRGB, ``texture`` pictures.
    """

    vertices: FloatArray
    faces: IntArray
    colors: ByteArray | None = None
    texture: Texture | None = None

    def to_trimesh(self) -> "trimesh.Trimesh":
        """A ``trimesh.Trimesh`` with the same vertices and faces, none merged, removed or reordered."""
        return Mesh(self.vertices, self.faces).to_trimesh()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a file; its name's extension says the format: .ply, .glb, .obj or .stl.

        Raises:
            ValueError: the extension is another one.
            OSError: the file cannot be written.
        """
        Path(path).write_bytes(writer_for(path).file(self.vertices, self.faces, self.colors, self.texture))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CompletedGeometry(Geometry):
    """A completed mesh, and what was done."""

    completion: Completion


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HalfGeometry(Geometry):
    """One half of a mesh, and where it was cut, with the lines for CalculiX and FreeCAD."""

    half: Half


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SectorGeometry(Geometry):
    """A sector of a mesh, and what it is one of, with the lines for CalculiX and FreeCAD."""

    sector: Sector


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AlignedGeometry(Geometry):
    """A mesh laid along the axes, and how it was moved ``(4, 4)``."""

    matrix: FloatArray


def detect(
    mesh: MeshLike,
    *,
    mode: Mode = "full",
    max_error: float = 4e-4,
    level: LevelName = "auto",
    tolerance: float | None = None,
    include: Collection[Include] = (),
    weights: str = "default",
) -> DetectResponse:
    """The symmetries of a mesh, as ``POST /detect`` and `app.client.client.Client.detect` answer.

    Args:
        mesh: the path of a file, a ``trimesh`` object, ``(vertices, faces)``, or a `model.Mesh`.
        mode: ``full``: all symmetries, refined; ``paper``: the network's output, validated as there.
        max_error: largest symmetry error of a result, unit frame.
        level: of the groups that hold, which one is answered with: ``auto``, ``exact``.
        tolerance: instead of a level, the largest group within this RMS deviation, input units.
        include: ``rejected`` candidates, the result as ``bop`` JSON.
        weights: ``default``, ``paper``, or the path of a .safetensors file; loaded once.

    Raises:
        model.MeshError: the mesh cannot be used; the subclass and the message say why.
        model.CheckpointError: the weights cannot.
        OSError: the file cannot be opened.
        ValueError: an option is none that ``POST /detect`` takes.
    """
    require(DetectQuery, mode=mode, max_error=max_error, level=level, tolerance=tolerance, include=list(include))
    detector = detector_of(weights)
    started = time.perf_counter()
    triangles = as_mesh(mesh)
    parsed = time.perf_counter()
    detection = detector.detect(triangles, mode=mode, max_error=max_error, level=level, tolerance=tolerance)
    return to_response(detection, detector, _name(mesh), include, started, parsed)


def complete(
    mesh: MeshLike,
    *,
    plane: PlaneLike | None = None,
    symmetrize: bool = False,
    max_error: float = 4e-4,
    weights: str = "default",
) -> CompletedGeometry:
    """A mesh completed by its mirror image, as ``POST /complete`` does it.

    Args:
        mesh: as for `detect`.
        plane: the plane to mirror at; without one, the best that is detected.
        symmetrize: whether to average both halves.
        max_error: largest symmetry error of a plane that is detected; a damaged mesh may need more.
        weights: as for `detect`.

    Raises:
        model.errors.NoPlaneError: no plane was given, and none detected.
        model.MeshError, model.CheckpointError, OSError, ValueError: as for `detect`.
    """
    require(CompleteQuery, max_error=max_error)
    started = time.perf_counter()
    given = None if plane is None else plane_numbers(plane).tolist()
    options = CompleteOptions(given, symmetrize, max_error)
    triangles, detector = as_mesh(mesh, looks=True), detector_of(weights)
    answer, result = complete_mesh(
        detector, triangles, _name(mesh), options, started, time.perf_counter()
    )  # fmt: skip
    return CompletedGeometry(completion=answer.completion, **_arrays(result))


def align(mesh: MeshLike, *, max_error: float = 4e-4, weights: str = "default") -> AlignedGeometry:
    """A copy of a mesh with its symmetry plane on YZ and its main axis on Z; see `model.completion.alignment`.

    Raises:
        model.errors.NoPlaneError: it has neither.
        model.MeshError, model.CheckpointError, OSError, ValueError: as for `detect`.
    """
    require(AlignQuery, max_error=max_error)
    started = time.perf_counter()
    triangles, detector = as_mesh(mesh, looks=True), detector_of(weights)
    done, result = align_mesh(
        detector, triangles, _name(mesh), AlignOptions(max_error), started, time.perf_counter()
    )  # fmt: skip
    return AlignedGeometry(matrix=np.array(done.alignment.matrix), **_arrays(result))


def halve(
    mesh: MeshLike,
    plane: PlaneLike | None = None,
    *,
    positive: bool = True,
    capped: bool = False,
    max_error: float = 4e-4,
    weights: str = "default",
) -> HalfGeometry:
    """One half of a mesh, cut exactly at a plane, as ``POST /halve`` cuts it.

    Args:
        mesh: as for `detect`.
        plane: the plane to cut at; without one, the best that is detected.
        positive: whether the side stays that the normal points to, or else the other.
        capped: whether the cut is closed, where its outline is.
        max_error: largest symmetry error of a plane that is detected.
        weights: as for `detect`.

    Raises:
        model.errors.NoPlaneError: no plane was given, and none detected.
        model.MeshError, model.CheckpointError, OSError, ValueError: as for `detect`.
    """
    require(HalveQuery, max_error=max_error)
    started = time.perf_counter()
    given = None if plane is None else plane_numbers(plane).tolist()
    triangles, detector = as_mesh(mesh, looks=True), detector_of(weights)
    options = HalveOptions(given, positive, max_error, capped)
    done, result = halve_mesh(detector, triangles, _name(mesh), options, started, time.perf_counter())
    return HalfGeometry(half=half_with_lines(done.half), **_arrays(result))


def sector(
    mesh: MeshLike,
    *,
    order: int | None = None,
    axis: Sequence[float] | None = None,
    point: Sequence[float] = (0.0, 0.0, 0.0),
    start: Sequence[float] | None = None,
    capped: bool = True,
    max_error: float = 4e-4,
    weights: str = "default",
) -> SectorGeometry:
    """One of n equal sectors of a mesh, as ``POST /sector`` cuts it; see `model.completion.sector`.

    Args:
        mesh: as for `detect`.
        order: how many sectors make up the whole; without it, the order of the axis.
        axis: direction of the axis; without one, the detected axis of the highest order. Needs an order.
        point: a point on that axis.
        start: which way from the axis the first cut goes; without it, where the cuts are short.
        capped: whether the cuts are closed.
        max_error: largest symmetry error of an axis that is detected.
        weights: as for `detect`.

    Raises:
        model.errors.NoAxisError: no axis was given, and none detected that will do.
        model.MeshError, model.CheckpointError, OSError, ValueError: as for `detect`.
    """
    given = {"axis": axis, "point": None if axis is None else point, "start": start}
    texts = {name: None if value is None else ",".join(map(repr, map(float, value))) for name, value in given.items()}
    query = require(SectorQuery, order=order, capped=capped, max_error=max_error, **texts)
    started = time.perf_counter()
    triangles, detector = as_mesh(mesh, looks=True), detector_of(weights)
    options = SectorOptions(query.line, order, query.way, max_error, capped)
    done, result = sector_mesh(detector, triangles, _name(mesh), options, started, time.perf_counter())
    return SectorGeometry(sector=sector_with_lines(done.sector), **_arrays(result))


def _arrays(mesh: Mesh) -> dict[str, Any]:
    return {"vertices": mesh.vertices, "faces": mesh.faces, "colors": mesh.colors, "texture": mesh.texture}


def writer_for(path: str | os.PathLike[str]) -> MeshWriter:
    """The writer for a file's name.

    Raises:
        ValueError: there is none for its extension.
    """
    return MESH_WRITERS[mesh_format(path)]


def mesh_format(path: str | os.PathLike[str]) -> str:
    """The format that a file's name tells.

    Raises:
        ValueError: there is no writer for it.
    """
    extension = Path(path).suffix[1:].lower()
    if extension not in MESH_WRITERS:
        raise ValueError(f"the name must end in {', '.join('.' + name for name in MESH_WRITERS)}")
    return extension


@functools.cache
def detector_of(weights: str) -> "SymmetryDetector":
    """The detector with these weights, loaded once.

    Raises:
        model.CheckpointError: they cannot be used.
    """
    return detection.load_detector(weights)


def _name(mesh: MeshLike) -> str:
    return Path(mesh).name if isinstance(mesh, str | os.PathLike) and not isinstance(mesh, Mesh) else ""
