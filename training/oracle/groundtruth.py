"""`training groundtruth`: the exhaustive search over folders of meshes, into one file (`training.oracle.truth`)."""

import hashlib
import json
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from model.errors import PRSNetError
from model.geometry.frames import UnitFrame
from model.geometry.transforms import canonical_sign
from model.types import FloatArray, IntArray
from training.layouts import SourceFile, find_meshes, parse
from training.oracle.exhaustive import Search, Settings
from training.oracle.truth import Truth, TruthAxis, load, save
from training.parallel import spread

__all__ = ["Summary", "Truth", "TruthAxis", "find_symmetries", "groundtruth", "load", "save"]


class Summary(NamedTuple):
    """What a run did: ``shapes`` in the file, ``searched`` now, ``skipped`` because they cannot be read."""

    shapes: int
    searched: int
    skipped: int


def find_symmetries(vertices: FloatArray, faces: IntArray, settings: Settings | None = None) -> Truth:
    """All planes and axes of a mesh that an exhaustive search finds.

    Args:
        vertices: ``(v, 3)`` float64, any frame.
        faces: ``(f, 3)`` int32.
        settings: how thorough the search is.

    Returns:
        what was found, in the unit frame of the mesh: every distinct local minimum up to an error of 4e-4.

    Raises:
        DegenerateMeshError: the mesh has no area.
    """
    frame = UnitFrame.of(vertices, faces)
    search = Search(frame.to_unit(vertices), faces, settings or Settings())
    search.run()
    best_first = np.argsort(search.plane_errors, kind="stable")
    planes = search.planes[best_first]
    return Truth(
        center=frame.center,
        scale=frame.scale,
        planes=planes * np.array([canonical_sign(plane) for plane in planes]).reshape(-1, 1),
        plane_errors=search.plane_errors[best_first],
        plane_continuous=search.continuous[best_first],
        axes=[
            TruthAxis(axis.direction * canonical_sign(axis.direction), axis.point, axis.order, axis.error)
            for axis in sorted(search.axes, key=lambda axis: axis.error)
        ],
    )


def groundtruth(
    folders: Sequence[Path],
    out: Path,
    settings: Settings | None = None,
    *,
    limit: int | None = None,
    workers: int = 1,
    progress: bool = True,
) -> Summary:
    """Search every mesh below ``folders`` and write ``out``; see `training groundtruth --help`.

    Shapes are kept in ``out`` with the suffix ``.part``, one line each as soon as it is done: a run that was cut off
    is resumed.

    Raises:
        ValueError: no meshes, or the part was begun with other settings.
    """
    settings = settings or Settings()
    sources = find_meshes(folders)[:limit]
    part = out.with_name(out.name + ".part")
    head = json.dumps({"settings": asdict(settings)})
    done: dict[str, dict[str, Any]] = {}
    if part.is_file():
        first, *lines = part.read_text(encoding="utf-8").splitlines()
        if first != head:
            raise ValueError(f"{part} was begun with other settings; remove it to begin again")
        for line in lines:
            record = json.loads(line)
            done[record["name"]] = record
    else:
        part.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(head + "\n", encoding="utf-8")
    left = [(source, settings) for source in sources if source.name not in done]
    with part.open("a", encoding="utf-8") as lines:
        found = spread(_search, left, workers, chunk=4)
        for record in tqdm(found, total=len(left), unit="mesh", disable=not progress, mininterval=30.0):
            done[record["name"]] = record
            lines.write(json.dumps(record, separators=(",", ":")) + "\n")
            lines.flush()
    records = [done[source.name] for source in sources]
    entries = {record["name"]: Truth.from_entry(record["entry"]) for record in records if "entry" in record}
    digest = hashlib.sha256("".join(f"{record['name']} {record['sha256']}\n" for record in records).encode())
    save(out, entries, asdict(settings), digest.hexdigest())
    part.unlink()
    return Summary(len(entries), len(left), len(records) - len(entries))


def _search(job: tuple[SourceFile, Settings]) -> dict[str, Any]:
    """One line of the part: name, digest and time of a file, and its entry or why it was skipped."""
    source, settings = job
    began = time.perf_counter()
    record: dict[str, Any] = {"name": source.name, "sha256": ""}
    try:
        content = source.path.read_bytes()
        record["sha256"] = hashlib.sha256(content).hexdigest()
        mesh = parse(content, source.path.name)
        record["entry"] = find_symmetries(mesh.vertices, mesh.faces, settings).to_entry()
    except (PRSNetError, OSError) as error:
        record["skipped"] = str(error)
    record["seconds"] = round(time.perf_counter() - began, 2)
    return record
