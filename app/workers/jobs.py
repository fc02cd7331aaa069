"""One job, from the bytes of a file to what the worker sends back: JSON, and geometry where it was asked for."""

from collections.abc import Callable

from app.completion import CompleteOptions, complete_file
from app.detection import MeshLimits, Options, SymmetryDetector, detect_file
from app.editing import AlignOptions, EditOptions, HalveOptions, SectorOptions, edit_file
from app.outputs.mesh_file import MeshWriter
from app.outputs.registry import MESH_WRITERS
from app.schemas import to_json
from app.workers.wire import Job
from model.errors import MeshTooLargeError
from model.formats.conversion import files_at_hand
from model.formats.reading import no_resources
from model.meshes.mesh import Mesh

_FREE_BYTES, _GROWTH = 4 << 20, 200
"""A small file that holds one part many times is not worked out for its client without end."""


def perform(
    detector: SymmetryDetector, job: Job, data: bytes, on_parsed: Callable[[], None] = lambda: None
) -> tuple[bytes, bytes | None]:
    """The answer as JSON, and the body of the mesh file that goes with it.

    Raises:
        model.errors.MeshError: the mesh is to blame.
    """
    data, files = job.files(data)
    resources = files_at_hand(files) if files else no_resources
    limits = MeshLimits(job.max_vertices, job.max_faces, job.max_nodes, job.max_unpacked_bytes)
    if job.task == "complete":
        options = CompleteOptions(job.plane, job.symmetrize, job.max_error)
        answer, mesh = complete_file(detector, data, job.filename, options, limits, on_parsed, resources)
        body = _body(MESH_WRITERS[job.geometry or "ply"], mesh, answer.mesh.bounds, _most(job))
        return answer.model_dump_json(by_alias=True).encode(), body
    if job.task != "detect":
        edit: EditOptions = AlignOptions(job.max_error)
        if job.task == "halve":
            edit = HalveOptions(job.plane, job.positive, job.max_error, job.capped)
        if job.task == "sector":
            edit = SectorOptions(job.line, job.order, job.start, job.max_error, job.capped)
        edited, mesh = edit_file(detector, data, job.filename, edit, limits, on_parsed, resources)
        body = _body(MESH_WRITERS[job.geometry or "ply"], mesh, edited.mesh.bounds, _most(job))
        return edited.model_dump_json(by_alias=True).encode(), body
    options = Options(job.mode, job.max_error, job.include, job.level, job.tolerance)
    response, mesh = detect_file(
        detector, data, job.filename, options, limits, on_parsed, resources, looks=job.geometry is not None
    )
    text = to_json(response, options.include)
    if job.geometry is None:
        return text, None
    body = _body(MESH_WRITERS[job.geometry], mesh, response.mesh.bounds, _most(job))
    return text, body


def _most(job: Job) -> int:
    """Bytes an answer may have: what the setting says, or some hundred times the file where that is less."""
    return min(job.max_answer_bytes, _FREE_BYTES + _GROWTH * job.size)


def _body(writer: MeshWriter, mesh: Mesh, bounds: list[list[float]], most: int) -> bytes:
    # Before anything is made where the size is known; a text may be far smaller than the most it can be.
    if not writer.varies and writer.size(len(mesh.vertices), len(mesh.faces)) > most:
        raise MeshTooLargeError(_too_large(most))
    body = writer.body(mesh.vertices, mesh.faces, bounds, mesh.colors, mesh.texture)
    if len(body) > most:
        raise MeshTooLargeError(_too_large(most))
    return body


def _too_large(most: int) -> str:
    return (
        f"The answer would hold more than {most} bytes of geometry, the limit for a file of this size; "
        "send a mesh with fewer faces, or ask for GLB."
    )
