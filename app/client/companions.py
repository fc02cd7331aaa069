"""The files that a mesh file refers to: a client sends them along."""

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from urllib.parse import unquote

_LIBRARY = re.compile(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", re.MULTILINE)
_TEXTURE = re.compile(rb"^comment[ \t]+TextureFile[ \t]+(.+?)[ \t]*$", re.MULTILINE | re.IGNORECASE)
_LONGEST_HEADER = 1 << 20
_PICTURE = re.compile(rb"^[ \t]*map_Kd[ \t]+(?:-.*[ \t])?(\S.*?)[ \t\r]*$", re.MULTILINE | re.IGNORECASE)


def companions(path: Path, *, looks: bool = False) -> list[Path]:
    """The files beside a mesh file, or in folders beside it, that it refers to.

    Those are the buffers of a .gltf file; with ``looks`` also its pictures, those of a .ply file, and an .obj file's
    materials and theirs.
    What cannot be read is left to the service, which says what is missing.

    Raises:
        OSError: the file cannot be opened.
    """
    match path.suffix.lower():
        case ".gltf":
            return _beside(path, _gltf_uris(path.read_bytes(), looks))
        case ".obj" if looks:
            libraries = _beside(path, _names(_LIBRARY, path.read_bytes()))
            pictures = [name for each in libraries for name in _names(_PICTURE, each.read_bytes())]
            return [*libraries, *_beside(path, pictures)]
        case ".ply" if looks:
            with path.open("rb") as file:
                header, end, _ = file.read(_LONGEST_HEADER).partition(b"end_header")
            return _beside(path, _names(_TEXTURE, header.replace(b"\r", b"\n"))) if end else []
        case _:
            return []


def _gltf_uris(data: bytes, looks: bool) -> list[object]:
    try:
        document: Any = json.loads(data)
        entries: list[Any] = [*document.get("buffers", []), *(document.get("images", []) if looks else ())]
        return [entry["uri"] for entry in entries if "uri" in entry]
    except (ValueError, RecursionError, TypeError, KeyError, AttributeError):
        return []


def _names(pattern: re.Pattern[bytes], data: bytes) -> list[object]:
    return [match.group(1).decode("utf-8", "replace") for match in pattern.finditer(data)]


def _beside(path: Path, names: Iterable[object]) -> list[Path]:
    """Those of the named files that are in the folder of one, or in folders in there."""
    folder, found = path.parent.resolve(), dict[Path, None]()
    for name in names:
        if not isinstance(name, str) or name[:5].lower() == "data:":
            continue
        try:
            beside = (folder / unquote(name).replace("\\", "/")).resolve()
            if beside.is_relative_to(folder) and beside.is_file():
                found[beside] = None
        except (OSError, ValueError):
            continue
    return list(found)
