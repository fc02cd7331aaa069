"""What both clients send, and what they make of the answer: everything but the sending."""

import email.utils
import os
import random
import time
from collections.abc import Collection, Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeAlias, TypeVar, Union

import httpx
from pydantic import ValidationError

from app.client.companions import companions
from app.client.errors import UnexpectedAnswerError, UnreachableError, for_problem
from app.edit_schemas import ALIGNMENT, COMPLETION, HALF, SECTOR, Alignment, Completion, Half, Sector
from app.planes import PlaneLike, plane_numbers
from app.schemas import KEY_HEADER, Include, LevelName, Mode, Problem, Schema

if TYPE_CHECKING:
    from model.formats.conversion import MeshLike

FIELD = "file"
Source: TypeAlias = Union["MeshLike", tuple[str, bytes], Mapping[str, bytes]]
"""What a client can send: see `model.formats.conversion.MeshLike`, where the path of a .gltf file brings the files it
refers to; or a file name and the file's bytes; or several by name, of which one is a mesh."""

_WORTH_ANOTHER_TRY = frozenset({429, 503})
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.2, 30.0

S = TypeVar("S", bound=Schema)


@dataclass(frozen=True, slots=True)
class MeshFile:
    """A mesh as the file it came as."""

    data: bytes
    format: str

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the file.

        Raises:
            OSError: it cannot be written.
        """
        Path(path).write_bytes(self.data)


@dataclass(frozen=True, slots=True)
class CompletedFile(MeshFile):
    """A completed mesh, and what was done."""

    completion: Completion


@dataclass(frozen=True, slots=True)
class HalfFile(MeshFile):
    """Half a mesh, and what was done."""

    half: Half


@dataclass(frozen=True, slots=True)
class SectorFile(MeshFile):
    """A sector of a mesh, and what was done, with the lines for CalculiX and FreeCAD."""

    sector: Sector


@dataclass(frozen=True, slots=True)
class AlignedFile(MeshFile):
    """A mesh laid along the axes, and how it was moved."""

    alignment: Alignment


@dataclass(frozen=True, slots=True)
class Call:
    """One request, that can be made several times."""

    method: str
    path: str
    query: Mapping[str, Any]
    source: Source | None = None
    accept: str | None = None
    looks: bool = False  # whether what comes back is a mesh, which shall look like this one

    @contextmanager
    def arguments(self) -> Generator[dict[str, Any], None, None]:
        """Arguments for httpx, with the file opened anew."""
        with ExitStack() as stack:
            given: dict[str, Any] = {"params": self.query}
            if self.source is not None:
                given["files"] = [
                    (FIELD, (name, content, "application/octet-stream"))
                    for name, content in _upload(self.source, stack, looks=self.looks)
                ]
            if self.accept:
                given["headers"] = {"Accept": self.accept}
            yield given


def _upload(source: Source, stack: ExitStack, *, looks: bool) -> list[tuple[str, bytes | BinaryIO]]:
    """Names and contents of the files to send."""
    if isinstance(source, Mapping):
        return list(source.items())
    if isinstance(source, tuple) and len(source) == 2 and isinstance(source[0], str) and isinstance(source[1], bytes):
        return [(source[0], source[1])]
    if isinstance(source, str | os.PathLike):
        path = Path(source)
        return [(item.name, stack.enter_context(item.open("rb"))) for item in (path, *companions(path, looks=looks))]
    from app.outputs.ply import WRITER  # here: numba takes a second to import, and files do not need it
    from model.formats.conversion import as_mesh

    mesh = as_mesh(source)
    return [("mesh.ply", WRITER.file(mesh.vertices, mesh.faces, mesh.colors))]


def detect_call(
    mesh: Source,
    mode: Mode,
    max_error: float,
    include: Collection[Include],
    format: str | None = None,
    level: LevelName = "auto",
    tolerance: float | None = None,
) -> Call:
    """``POST /detect``."""
    query: dict[str, Any] = {"mode": mode, "max_error": max_error, "include": list(include), "level": level}
    if tolerance is not None:
        query["tolerance"] = tolerance
    return Call("POST", "/detect", query | ({"format": format} if format else {}), mesh, looks=format == "glb")


def complete_call(mesh: Source, format: str, plane: PlaneLike | None, symmetrize: bool, max_error: float) -> Call:
    """``POST /complete``."""
    query: dict[str, Any] = {"format": format, "symmetrize": symmetrize, "max_error": max_error}
    return Call("POST", "/complete", query | _plane_query(plane), mesh, looks=True)


def halve_call(
    mesh: Source, format: str, plane: PlaneLike | None, positive: bool, capped: bool, max_error: float
) -> Call:
    """``POST /halve``."""
    query: dict[str, Any] = {"format": format, "other": not positive, "capped": capped, "max_error": max_error}
    return Call("POST", "/halve", query | _plane_query(plane), mesh, looks=True)


def sector_call(
    mesh: Source,
    format: str,
    order: int | None,
    axis: Sequence[float] | None,
    point: Sequence[float] | None,
    start: Sequence[float] | None,
    capped: bool,
    max_error: float,
) -> Call:
    """``POST /sector``."""
    query: dict[str, Any] = {"format": format, "capped": capped, "max_error": max_error}
    if order is not None:
        query["order"] = order
    for name, vector in (("axis", axis), ("point", point), ("start", start)):
        if vector is not None:
            query[name] = ",".join(repr(float(value)) for value in vector)
    return Call("POST", "/sector", query, mesh, looks=True)


def align_call(mesh: Source, format: str, max_error: float) -> Call:
    """``POST /align``."""
    return Call("POST", "/align", {"format": format, "max_error": max_error}, mesh, looks=True)


def _plane_query(plane: PlaneLike | None) -> dict[str, Any]:
    if plane is None:
        return {}
    *normal, offset = plane_numbers(plane).tolist()
    return {"normal": ",".join(map(repr, normal)), "offset": offset}


def parsed(schema: type[S], text: bytes | str) -> S:
    """An answer.

    Raises:
        UnexpectedAnswerError: it is none of this schema.
    """
    try:
        return schema.model_validate_json(text)
    except ValidationError as error:
        raise UnexpectedAnswerError(f"The answer is no {schema.__name__} of this version of the client.") from error


def completed(response: httpx.Response, format: str) -> CompletedFile:
    """The answer of ``POST /complete``.

    Raises:
        UnexpectedAnswerError: it does not say what was done.
    """
    done = parsed(Completion, response.headers.get(COMPLETION, ""))
    return CompletedFile(response.content, format, done)


def halved(response: httpx.Response, format: str) -> HalfFile:
    """The answer of ``POST /halve``.

    Raises:
        UnexpectedAnswerError: it does not say what was done.
    """
    return HalfFile(response.content, format, parsed(Half, response.headers.get(HALF, "")))


def cut(response: httpx.Response, format: str) -> SectorFile:
    """The answer of ``POST /sector``.

    Raises:
        UnexpectedAnswerError: it does not say what was done.
    """
    return SectorFile(response.content, format, parsed(Sector, response.headers.get(SECTOR, "")))


def aligned(response: httpx.Response, format: str) -> AlignedFile:
    """The answer of ``POST /align``.

    Raises:
        UnexpectedAnswerError: it does not say what was done.
    """
    return AlignedFile(response.content, format, parsed(Alignment, response.headers.get(ALIGNMENT, "")))


def checked(response: httpx.Response) -> httpx.Response:
    """The response, if it is an answer and no problem.

    Raises:
        ProblemAnswerError, UnexpectedAnswerError: it is not.
    """
    if response.is_success:
        return response
    if "problem+json" in response.headers.get("content-type", ""):
        raise for_problem(parsed(Problem, response.content))
    raise UnexpectedAnswerError(f"The status is {response.status_code}, without a problem document.")


def pause(response: httpx.Response | None, attempt: int) -> float:
    """Seconds to wait before the next try: what the service asks for, or else twice as long as before."""
    own = _FIRST_PAUSE_S * 2**attempt * random.uniform(0.5, 1.0)
    asked = response.headers.get("retry-after", "") if response is not None else ""
    if asked.isascii() and asked.isdigit():
        own = max(own, float(asked))
    elif asked:
        with suppress(ValueError):
            own = max(own, email.utils.parsedate_to_datetime(asked).timestamp() - time.time())
    return min(own, _LONGEST_PAUSE_S)


class ClientConfig:
    """What both clients are made from."""

    def __init__(
        self, url: str, api_key: str | None, timeout: httpx.Timeout | float, retries: int, transport: Any
    ) -> None:
        if retries < 0:
            raise ValueError("retries must not be negative")
        self.retries = retries
        headers = {} if api_key is None else {KEY_HEADER: api_key}
        self.arguments: dict[str, Any] = {
            "base_url": url, "headers": headers, "timeout": timeout, "transport": transport
        }  # fmt: skip

    def final(self, response: httpx.Response, attempt: int) -> bool:
        """Whether a response is the last word."""
        return response.status_code not in _WORTH_ANOTHER_TRY or attempt == self.retries

    def unreachable(self, error: httpx.TransportError, attempt: int) -> UnreachableError | None:
        """The exception, if another try is not worth it: the last one failed, or the time is up."""
        late = isinstance(error, httpx.TimeoutException) and not isinstance(error, httpx.ConnectTimeout)
        if attempt < self.retries and not late:
            return None
        return UnreachableError(f"No answer: {str(error) or type(error).__name__}.")
