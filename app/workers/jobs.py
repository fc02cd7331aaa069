"""One job, from the bytes of a file to what the worker sends back: JSON, and geometry where it was asked for."""

from collections.abc import Callable

from app.completion import CompleteOptions, complete_file
from app.detection import MeshLimits, Options, SymmetryDetector, detect_file
from app.outputs.mesh_file import MeshWriter
from app.outputs.registry import MESH_WRITERS
from app.schemas import to_json
from app.workers.wire import Job
from model.errors import MeshTooLargeError
from model.types import FloatArray, IntArray


def perform(
    detector: SymmetryDetector, job: Job, data: bytes, on_parsed: Callable[[], None] = lambda: None
) -> tuple[bytes, bytes | None]:
    """The answer as JSON, and the body of the mesh file that goes with it.

    Raises:
        model.errors.MeshError: the mesh is to blame.
    """
    limits = MeshLimits(job.max_vertices, job.max_faces, job.max_nodes, job.max_unpacked_bytes)
    if job.task == "complete":
        options = CompleteOptions(job.plane, job.symmetrize, job.max_error)
        answer, vertices, faces = complete_file(detector, data, job.filename, options, limits, on_parsed)
        body = _body(MESH_WRITERS[job.geometry or "ply"], vertices, faces, answer.mesh.bounds, job.max_answer_bytes)
        return answer.model_dump_json(by_alias=True).encode(), body
    options = Options(job.mode, job.max_error, job.include, job.level, job.tolerance)
    response, mesh = detect_file(detector, data, job.filename, options, limits, on_parsed)
    text = to_json(response, options.include)
    if job.geometry is None:
        return text, None
    body = _body(MESH_WRITERS[job.geometry], mesh.vertices, mesh.faces, response.mesh.bounds, job.max_answer_bytes)
    return text, body


def _body(writer: MeshWriter, vertices: FloatArray, faces: IntArray, bounds: list[list[float]], most: int) -> bytes:
    # Before anything is made where the size is known; a text may be far smaller than the most it can be.
    if not writer.varies and writer.size(len(vertices), len(faces)) > most:
        raise MeshTooLargeError(_too_large(most))
    body = writer.body(vertices, faces, bounds)
    if len(body) > most:
        raise MeshTooLargeError(_too_large(most))
    return body


def _too_large(most: int) -> str:
    return f"The answer would hold more than {most} bytes of geometry; send a mesh with fewer faces, or ask for GLB."
