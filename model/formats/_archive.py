"""Zip archives that hold one mesh, as shops of models send them: the mesh, and what it keeps beside it."""

import zipfile
import zlib
from io import BytesIO
from pathlib import PurePath
from urllib.parse import unquote

from model.errors import MeshTooLargeError, UnreadableMeshError, UnsupportedFormatError
from model.formats import FORMATS, SOUGHT
from model.formats._common import Resources
from model.formats._foreign import foreign_content

_CHUNK = 1 << 20
_DAMAGED = "The zip archive is damaged; pack it anew, or send the mesh that is inside."


def open_archive(data: bytes, max_unpacked_bytes: int) -> tuple[bytes, str, Resources]:
    """The one mesh in a zip archive, its name, and the other files of the archive for what it refers to.

    What is unpacked is counted while it is: beyond ``max_unpacked_bytes`` in all it ends. Archives in it stay shut.

    Raises:
        UnsupportedFormatError: there is no mesh in it, or there are several.
        UnreadableMeshError: it is damaged, encrypted, or compressed in an unusual way.
        MeshTooLargeError: it unpacks to more than allowed.
    """
    try:
        archive = zipfile.ZipFile(BytesIO(data))
        members = [info for info in archive.infolist() if not info.is_dir() and not _is_hidden(info.filename)]
    except (zipfile.BadZipFile, ValueError, EOFError, NotImplementedError, OSError) as error:
        words = foreign_content(data)
        if words and not data.startswith(b"PK"):
            raise UnsupportedFormatError(f"The file is named .zip but is {words}") from error
        raise UnreadableMeshError(_DAMAGED) from error
    meshes = [info for info in members if PurePath(info.filename).suffix[1:].lower() in SOUGHT]
    if len(meshes) != 1:
        kinds = " or ".join(sorted(f".{name}" for name in FORMATS if name in SOUGHT))
        what = f"{len(meshes)} meshes; send one of them" if meshes else f"no mesh; it is known by a name in {kinds}"
        raise UnsupportedFormatError(f"The zip archive holds {what}.")
    members.sort(key=lambda info: len(info.filename))
    left = max_unpacked_bytes

    def read(info: zipfile.ZipInfo) -> bytes:
        nonlocal left
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) or info.flag_bits & 1:
            raise UnreadableMeshError("The zip archive is encrypted, or compressed in an unusual way; pack it anew.")
        parts: list[bytes] = []
        try:
            with archive.open(info) as stream:
                while part := stream.read(_CHUNK):
                    left -= len(part)
                    if left < 0:
                        raise MeshTooLargeError(f"The zip archive unpacks to more than {max_unpacked_bytes} bytes.")
                    parts.append(part)
        except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError) as error:
            raise UnreadableMeshError(_DAMAGED) from error
        return b"".join(parts)

    def beside(name: str) -> bytes | None:
        """The file whose path ends like the name; of several that which lies highest."""
        wanted = PurePath(unquote(name).replace("\\", "/")).as_posix().casefold()
        last = wanted.rpartition("/")[2]
        found = [info for info in members if ("/" + info.filename.casefold()).endswith("/" + wanted)]
        found += [info for info in members if info.filename.casefold().rpartition("/")[2] == last]
        return read(found[0]) if found else None

    return read(meshes[0]), PurePath(meshes[0].filename).name, beside


def _is_hidden(name: str) -> bool:
    """Whether it is what systems put into archives unasked."""
    return name.startswith("__MACOSX/") or PurePath(name).name.startswith(".")
