"""Reads one mesh, with the files it refers to, out of a multipart/form-data request while it streams in.

Bytes are counted as they arrive. A small file stays in memory, a larger one goes to disk
(``app.http.spool``); a client that sends too slowly gets 408.
"""

import asyncio
import re
from typing import TYPE_CHECKING

from fastapi import Request
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header

from app.http.slots import UploadSlot
from app.http.spool import Spool, Upload
from app.problems import MALFORMED, OVERLOADED, UPLOAD_TOO_LARGE, UPLOAD_TOO_SLOW, ProblemError
from app.settings import Settings
from model.formats import FORMATS

if TYPE_CHECKING:
    from python_multipart.multipart import MultipartCallbacks

FIELD = "file"
_CURL = "curl -F file=@chair.obj URL"
_MAX_NAME = 255
_MOST_FILES = 64
_LONGEST_NAMES = 8192  # bytes of all together: they go to a worker in one small frame


def base_name(name: str) -> str:
    """The last part of a client's file name: no path, no control characters, of bounded length.

    Empty when nothing is left. A long name is cut at its start: its extension tells the format.
    """
    last = re.split(r"[/\\]", name)[-1]
    printable = "".join(character for character in last if character.isprintable()).strip()
    return "" if printable in {".", ".."} else printable[-_MAX_NAME:]


def _malformed(detail: str) -> ProblemError:
    how = f"Send one mesh as multipart/form-data: {_CURL}; files that it refers to may go beside it."
    return ProblemError(MALFORMED, f"{detail} {how}")


def _too_large(limit: int) -> ProblemError:
    return ProblemError(UPLOAD_TOO_LARGE, f"The upload is larger than the limit of {limit} bytes.")


class _Form:
    """Collects the parts a request may have: the field ``file`` with a file name, once or several times."""

    def __init__(self, boundary: bytes, spool: Spool) -> None:
        self.complete = False
        self._names: list[str] = []
        self._sizes: list[int] = []
        self._spool = spool
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
            raise _malformed(f'The field "{FIELD}" has no file name, and the format follows from its extension.')
        name = base_name(options[b"filename"].decode("utf-8", "replace"))
        if not name:
            raise _malformed(f'The field "{FIELD}" has an empty file name, and the format follows from its extension.')
        if len(self._names) == _MOST_FILES or len("".join([*self._names, name]).encode()) > _LONGEST_NAMES:
            raise _malformed(f"The form has more than {_MOST_FILES} files, or longer names than those may have.")
        if name.casefold() in {other.casefold() for other in self._names}:
            raise _malformed("The form has several files of one name.")
        self._names.append(name)
        self._sizes.append(0)

    def _part_data(self, data: bytes, start: int, end: int) -> None:
        self._sizes[-1] += end - start
        self._spool.write(memoryview(data)[start:end])

    def _end(self) -> None:
        self.complete = True

    def mesh(self) -> str:
        """The name of the one file that is a mesh; the others are what it refers to.

        Raises:
            ProblemError: there is none, or there are several.
        """
        if not self._names:
            raise _malformed(f'The form has no field "{FIELD}".')
        if len(self._names) == 1:
            return self._names[0]
        meshes = [name for name in self._names if name.rpartition(".")[2].lower() in FORMATS]
        if len(meshes) != 1:
            found = "several files that are meshes" if meshes else "several files, none of which is a mesh"
            raise _malformed(f"The form has {found}.")
        return meshes[0]

    def parts(self) -> tuple[tuple[str, int], ...]:
        """Name and size of every file, if there are several."""
        return tuple(zip(self._names, self._sizes, strict=True)) if len(self._names) > 1 else ()


def _declared_length(request: Request) -> int:
    value = request.headers.get("content-length", "")
    # What is no plain number is left to the counting; the server has refused contradictory framing before.
    return int(value) if value.isascii() and value.isdigit() and len(value) < 20 else 0


async def read_upload(request: Request, settings: Settings, slot: UploadSlot | None = None) -> Upload:
    """The files of a multipart request whose body is at most ``settings.max_upload_bytes``; the caller closes it.

    A larger ``Content-Length`` is refused before anything is read, a larger body once the limit is passed. How much has
    come is noted in ``slot``, which a slow upload loses when it is wanted for another.

    Raises:
        ProblemError: ``upload-too-large`` (413), ``malformed-request`` (400), ``upload-too-slow`` (408), or
            ``overloaded`` (503) where the disk is full.
        starlette.requests.ClientDisconnect: the client left.
    """
    kind, options = parse_options_header(request.headers.get("content-type"))
    if kind != b"multipart/form-data" or not options.get(b"boundary"):
        raise _malformed("The request is not multipart/form-data with a boundary.")
    if _declared_length(request) > settings.max_upload_bytes:
        raise _too_large(settings.max_upload_bytes)
    spool = Spool(settings.spool_bytes, settings.spool_dir, hashing=settings.cache_bytes > 0)
    try:
        form = await _receive(request, options[b"boundary"], spool, settings, slot or UploadSlot(""))
        return spool.finish(form.mesh(), form.parts())
    except FormParserError as error:
        spool.close()
        raise _malformed("The multipart body is not well formed.") from error
    except OSError as error:
        spool.close()
        raise ProblemError(
            OVERLOADED, "There is no room to keep the upload. Try again in a minute.", {"Retry-After": "60"}
        ) from error
    except BaseException:
        spool.close()
        raise


async def _receive(request: Request, boundary: bytes, spool: Spool, settings: Settings, slot: UploadSlot) -> _Form:
    """Feed the body to the spool; what the form told about it."""
    form = _Form(boundary, spool)
    received = 0
    now = asyncio.get_running_loop().time
    end = slot.began + settings.upload_s
    chunks = request.stream()
    while True:
        due = slot.began + settings.stall_s + received / settings.upload_bytes_per_s
        try:
            async with asyncio.timeout_at(min(now() + settings.stall_s, end, due)) as patience:
                slot.on_eviction = lambda limit=patience: limit.reschedule(now())
                chunk = await anext(chunks, None)
        except TimeoutError as error:
            detail = (
                f"An upload may take {settings.upload_s:g} seconds, pause for {settings.stall_s:g}, and must bring "
                f"{settings.upload_bytes_per_s} bytes a second on average."
            )
            # The connection is of no more use: what the client may still send is not waited for.
            raise ProblemError(UPLOAD_TOO_SLOW, detail, {"Connection": "close"}) from error
        slot.on_eviction = None
        if chunk is None:
            break
        received += len(chunk)
        slot.received = received
        if received > settings.max_upload_bytes:
            raise _too_large(settings.max_upload_bytes)
        form.feed(chunk)
    if not form.complete:
        raise _malformed("The multipart body ends before its closing boundary." if received else "The body is empty.")
    return form
