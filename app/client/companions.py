"""The files that a mesh file refers to: a client sends them along."""

import json
from pathlib import Path
from typing import Any, cast
from urllib.parse import unquote


def companions(path: Path) -> list[Path]:
    """The files beside a .gltf file, or in folders beside it, that its buffers are in; none for other files.

    What cannot be read is left to the service, which says what is missing.

    Raises:
        OSError: the file cannot be opened.
    """
    if path.suffix.lower() != ".gltf":
        return []
    try:
        document: Any = json.loads(path.read_bytes())
        uris = [entry["uri"] for entry in document.get("buffers", []) if "uri" in entry]
    except (ValueError, RecursionError, TypeError, KeyError, AttributeError):
        return []
    folder, found = path.parent.resolve(), dict[Path, None]()
    for uri in cast(list[object], uris):
        if not isinstance(uri, str) or uri[:5].lower() == "data:":
            continue
        try:
            beside = (folder / unquote(uri)).resolve()
            if beside.is_relative_to(folder) and beside.is_file():
                found[beside] = None
        except (OSError, ValueError):
            continue
    return list(found)
