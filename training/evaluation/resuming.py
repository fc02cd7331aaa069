"""Records on disk as soon as they are made, so that an evaluation that was interrupted goes on where it stopped."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def resumed(file: Path | None, options: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The records of an earlier call, by ``name``; none if it was one with other options, as the first line says.

    Args:
        file: made if it is not there, begun anew if it is of other options; None: nothing is kept.
        options: of this call, plain values.
    """
    head = json.dumps({"options": options})
    if file is None:
        return {}
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    if not lines or lines[0] != head:
        file.write_text(head + "\n", encoding="utf-8")
        return {}
    records: dict[str, dict[str, Any]] = {}
    whole: list[str] = [head]
    for line in lines[1:]:
        try:
            record = json.loads(line)
        except json.JSONDecodeError:  # cut off while it was written
            continue
        records[record["name"]] = record
        whole.append(line)
    file.write_text("\n".join(whole) + "\n", encoding="utf-8")
    return records


def append(file: Path | None, record: Mapping[str, Any]) -> None:
    """Add a record to the file of `resumed`."""
    if file is not None:
        with file.open("a", encoding="utf-8") as lines:
            lines.write(json.dumps(record) + "\n")
