"""Reads one mesh file out of a multipart/form-data request while it streams in.

The body is parsed chunk by chunk into memory: nothing is spooled to disk (the service runs on a read-only
file system), and no more than the limit is ever held. Bytes are counted as they arrive.
"""

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from fastapi import Request
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header

from app.problems import MALFORMED, UPLOAD_TOO_LARGE, ProblemError

if TYPE_CHECKING:
    from python_multipart.multipart import MultipartCallbacks

FIELD = "file"
_CURL = "curl -F file=@chair.obj URL"
_MAX_NAME = 255


@dataclass(frozen=True, slots=True)
class Upload:
    """An uploaded file: its sanitised base name and its bytes."""

    filename: str
    data: bytes


def base_name(name: str) -> str:
    """The last part of a client's file name: no path, no control characters, of bounded length.

    Empty when nothing is left. A long name is cut at its start: its extension tells the format.
    """
    last = re.split(r"[/\\]", name)[-1]
    printable = "".join(character for character in last if character.isprintable()).strip()
    return "" if printable in {".", ".."} else printable[-_MAX_NAME:]


def _malformed(detail: str) -> ProblemError:
    return ProblemError(MALFORMED, f"{detail} Send one mesh as multipart/form-data: {_CURL}.")


def _too_large(limit: int) -> ProblemError:
    return ProblemError(UPLOAD_TOO_LARGE, f"The upload is larger than the limit of {limit} bytes.")


class _Form:
    """Collects the only part a request may have: the field ``file`` with a file name."""

    def __init__(self, boundary: bytes) -> None:
        self.filename: str | None = None
        self.data = bytearray()
        self.complete = False
        self._header_name = b""
        self._header_value = b""
        self._disposition = b""
        callbacks: MultipartCallbacks = {
            "on_part_begin": self._part_begin,
            "on_header_field": self._header_field,
            "on_header_value": self._header_value_part,
            "on_header_end": self._header_end,
            "on_headers_finished": self._headers_finished,
            "on_part_data": self._part_data,
            "on_end": self._end,
        }
        self._parser = MultipartParser(boundary, callbacks)

    def feed(self, chunk: bytes) -> None:
        self._parser.write(chunk)

    def _part_begin(self) -> None:
        self._disposition = b""

    def _header_field(self, data: bytes, start: int, end: int) -> None:
        self._header_name += data[start:end]

    def _header_value_part(self, data: bytes, start: int, end: int) -> None:
        self._header_value += data[start:end]

    def _header_end(self) -> None:
        if self._header_name.lower() == b"content-disposition":
            self._disposition = self._header_value
        self._header_name = self._header_value = b""

    def _headers_finished(self) -> None:
        options = parse_options_header(self._disposition.decode("latin-1"))[1]
        if options.get(b"name", b"").decode("latin-1") != FIELD:
            raise _malformed(
                f'The form has a field other than "{FIELD}"; options such as mode belong in the query string.'
            )
        if b"filename" not in options:
            raise _malformed(f'The field "{FIELD}" has no file name, and the format is told from its extension.')
        if self.filename is not None:
            raise _malformed("The form has several files.")
        self.filename = base_name(options[b"filename"].decode("utf-8", "replace"))
        if not self.filename:
            raise _malformed(f'The field "{FIELD}" has an empty file name, and the format is told from its extension.')

    def _part_data(self, data: bytes, start: int, end: int) -> None:
        self.data += memoryview(data)[start:end]

    def _end(self) -> None:
        self.complete = True


def _declared_length(request: Request) -> int:
    value = request.headers.get("content-length", "")
    # What is no plain number is left to the counting; the server has refused contradictory framing before.
    return int(value) if value.isascii() and value.isdigit() and len(value) < 20 else 0


async def read_upload(request: Request, limit: int) -> Upload:
    """The file of a multipart request whose body is at most ``limit`` bytes.

    A larger ``Content-Length`` is refused before anything is read, a larger body once the limit is passed.

    Raises:
        ProblemError: ``upload-too-large`` (413) or ``malformed-request`` (400).
        starlette.requests.ClientDisconnect: the client left.
    """
    kind, options = parse_options_header(request.headers.get("content-type"))
    if kind != b"multipart/form-data" or not options.get(b"boundary"):
        raise _malformed("The request is not multipart/form-data with a boundary.")
    if _declared_length(request) > limit:
        raise _too_large(limit)
    received = 0
    try:
        form = _Form(options[b"boundary"])
        async for chunk in request.stream():
            received += len(chunk)
            if received > limit:
                raise _too_large(limit)
            form.feed(chunk)
    except FormParserError as error:
        raise _malformed("The multipart body is not well formed.") from error
    if not form.complete:
        raise _malformed("The multipart body ends before its closing boundary." if received else "The body is empty.")
    if form.filename is None:
        raise _malformed(f'The form has no field "{FIELD}".')
    return Upload(form.filename, bytes(form.data))
