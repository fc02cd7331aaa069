"""What there is to know about a format of answers: one record, filled in beside the functions that write it."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

from app.outputs.mesh_file import MeshWriter
from app.schemas import DetectResponse, Include


@dataclass(frozen=True, slots=True)
class Options:
    """What a request asked for that changes how its answer is written."""

    max_error: float
    include: Collection[Include] = ()


@dataclass(frozen=True, slots=True)
class OutputFormat:
    """A format of answers.

    Attributes:
        name: the value of ``format=``, and the extension of a file.
        media_type: what the header Accept asks for, and Content-Type says.
        description: for the API documentation; Markdown, one sentence.
        write: the symmetries of one mesh. None where they are not written, or where ``mesh`` writes them.
        write_all: the symmetries of several meshes as one file, by the name of each; None where a file holds one.
        entry_name: what a mesh file is called in a collection of which ``write`` makes an entry. A file is such a
            collection even if of one mesh; None where it is none.
        mesh: how a mesh is written, alone (``POST /complete``) and, if it can be annotated, with its symmetries.
        include: what must be in the answer for ``write``, whether it was asked for or not.
        query_media_type: what Content-Type says where ``format=`` asked; None for ``media_type``.
        schema: OpenAPI schema of the content where it is JSON.
    """

    name: str
    media_type: str
    description: str
    write: Callable[[DetectResponse, Options], bytes] | None = None
    write_all: Callable[[Sequence[tuple[str, DetectResponse]], Options], bytes] | None = None
    entry_name: Callable[[PurePath], str] | None = None
    mesh: MeshWriter | None = None
    include: tuple[Include, ...] = ()
    query_media_type: str | None = None
    schema: dict[str, Any] | None = None

    @property
    def tells_symmetries(self) -> bool:
        """Whether ``POST /detect`` can answer with it."""
        return self.write is not None or (self.mesh is not None and self.mesh.annotated_head is not None)
