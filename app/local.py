"""The library: the same answers as the service gives, computed in this process.

>>> from app import detect
>>> detect("chair.obj").planes[0].matrix
"""

import functools
import os
import time
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app import detection
from app.completion import CompleteOptions, complete_mesh
from app.detection import to_response
from app.editing import AlignOptions, align_mesh, half_of
from app.outputs.mesh_file import MeshWriter
from app.outputs.registry import MESH_WRITERS
from app.planes import PlaneLike, plane_numbers
from app.queries import AlignQuery, CompleteQuery, DetectQuery
from app.refusals import require
from app.schemas import Completion, DetectResponse, Include, LevelName, Mode
from model.formats.conversion import MeshLike, as_mesh
from model.meshes.mesh import Mesh
from model.meshes.texture import Texture
from model.types import ByteArray, FloatArray, IntArray

if TYPE_CHECKING:
    import trimesh

    from app.detection import SymmetryDetector


@dataclass(frozen=True, slots=True, eq=False)
class CompletedGeometry:
    """A completed mesh: ``vertices`` ``(v, 3)``, ``faces`` ``(f, 3)``, what was done, and the looks if there are any.

    ``colors`` are ``(v, 4)`` uint8 sRGB, ``texture`` pictures.
    """

    vertices: FloatArray
    faces: IntArray
    completion: Completion
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
    return CompletedGeometry(result.vertices, result.faces, answer.completion, result.colors, result.texture)


@dataclass(frozen=True, slots=True, eq=False)
class AlignedGeometry:
    """A mesh laid along the axes: ``vertices`` ``(v, 3)``, ``faces`` ``(f, 3)``, and how it was moved ``(4, 4)``."""

    vertices: FloatArray
    faces: IntArray
    matrix: FloatArray
    colors: ByteArray | None = None
    texture: Texture | None = None

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a file; its name's extension says the format: .ply, .glb, .obj or .stl.

        Raises:
            ValueError: the extension is another one.
            OSError: the file cannot be written.
        """
        Path(path).write_bytes(writer_for(path).file(self.vertices, self.faces, self.colors, self.texture))


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
    return AlignedGeometry(
        result.vertices, result.faces, np.array(done.alignment.matrix), result.colors, result.texture
    )


def halve(mesh: MeshLike, plane: PlaneLike, *, positive: bool = True) -> tuple[FloatArray, IntArray]:
    """One half of a mesh, cut exactly at a plane and open there: vertices ``(v, 3)`` and faces ``(f, 3)``.

    Raises:
        model.MeshError: the mesh cannot be used, or nothing of it is on that side.
    """
    half = half_of(as_mesh(mesh), plane_numbers(plane), positive=positive)
    return half.vertices, half.faces


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
