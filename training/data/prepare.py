"""`training prepare`: folders of meshes to a prepared set (layout: `training.data.prepared`)."""

import csv
import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from model.errors import PRSNetError
from model.geometry.frames import UnitFrame
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.geometry.voxels import voxelize
from model.meshes.mesh import Mesh
from training.data.prepared import FORMAT_VERSION, dequantise, quantise
from training.layouts import SourceFile, find_meshes, parse
from training.parallel import spread

SHARD_SHAPES = 256


@dataclass(frozen=True, slots=True)
class Options:
    """What goes into a shard beside the meshes; a resumed preparation must be given the same."""

    resolution: int = 32
    samples: int = 4096
    mesh_only: bool = False


@dataclass(frozen=True, slots=True)
class Summary:
    """What a preparation did."""

    shapes: int
    skipped: int
    sha256: str


def prepare(
    folders: Sequence[Path],
    out: Path,
    options: Options,
    workers: int = 1,
    progress: bool = True,
    *,
    split: str | None = None,
    manifest: Path | None = None,
) -> Summary:
    """Prepare every mesh below ``folders`` into ``out``; shards that are complete are kept from an earlier run.

    Args:
        folders: in the layouts of `training.layouts`.
        out: folder of the prepared set.
        options: what goes into it.
        workers: processes.
        progress: whether a bar is shown.
        split: take only this part of the data, see `training.layouts.find_meshes`.
        manifest: sources, categories and licences, see there.

    Raises:
        ValueError: nothing to prepare, or ``out`` was begun with other files or options.
    """
    sources = find_meshes(folders, split=split, manifest=manifest)
    out.mkdir(parents=True, exist_ok=True)
    # What a manifest adds is part of the plan; sets begun without one go on as they were.
    known = [[source.licence, source.split] for source in sources]
    added = {"known": known} if any(any(pair) for pair in known) else {}
    plan = json.dumps({"options": asdict(options), "files": [source.name for source in sources], **added})
    stamp = hashlib.sha256(plan.encode()).hexdigest()
    begun = out / "plan.sha256"
    if begun.is_file() and begun.read_text() != stamp:
        raise ValueError(f"{out} was begun with other files or options; choose another folder")
    begun.write_text(stamp)
    jobs = [
        (sources[first : first + SHARD_SHAPES], out / f"shard-{number:05d}", options)
        for number, first in enumerate(range(0, len(sources), SHARD_SHAPES))
    ]
    results: list[dict[str, Any]] = []
    with tqdm(total=len(sources), unit="mesh", disable=not progress) as bar:
        for job, result in zip(jobs, spread(_prepare_shard, jobs, workers), strict=True):
            results.append(result)
            bar.update(len(job[0]))
    return _finish(out, results, options)


def _prepare_shard(job: tuple[list[SourceFile], Path, Options]) -> dict[str, Any]:
    """Write one shard, or return the record of one already complete. The record is written last."""
    sources, folder, options = job
    record_file = folder / "record.json"
    if record_file.is_file():
        return json.loads(record_file.read_text())
    folder.mkdir(exist_ok=True)
    shapes: list[dict[str, Any]] = []
    skipped: list[dict[str, str]] = []
    columns: dict[str, list[NDArray[Any]]] = {"vertices": [], "faces": [], "samples": [], "voxels": [], "closest": []}
    starts = [(0, 0)]
    for source in sources:
        try:
            arrays = prepare_shape(parse(source.path.read_bytes(), source.path.name), options)
        except (PRSNetError, OSError) as error:
            skipped.append({"name": source.name, "reason": str(error)})
            continue
        for key, array in arrays.items():
            columns[key].append(array)
        sizes = len(arrays["vertices"]), len(arrays["faces"])
        starts.append((starts[-1][0] + sizes[0], starts[-1][1] + sizes[1]))
        # Known or not: what a set without licences hashes to must not change.
        extra = {key: value for key in ("licence", "split") if (value := getattr(source, key))}
        shapes.append(
            {"name": source.name, "source": source.source, "category": source.category,
             "vertices": sizes[0], "faces": sizes[1], **extra}
        )  # fmt: skip
    digest = hashlib.sha256(json.dumps(shapes).encode())
    written = {"starts": np.array(starts, dtype=np.int64)}
    if shapes:
        flat = {"vertices": np.concatenate, "faces": np.concatenate}
        written |= {key: flat.get(key, np.stack)(parts) for key, parts in columns.items() if parts}
    for key in sorted(written):
        np.save(folder / f"{key}.npy", written[key])
        digest.update(key.encode() + written[key].tobytes())
    record = {"name": folder.name, "sha256": digest.hexdigest(), "shapes": shapes, "skipped": skipped}
    record_file.write_text(json.dumps(record))
    return record


def prepare_shape(mesh: Mesh, options: Options) -> dict[str, NDArray[Any]]:
    """The arrays of one shape, see `training.data.prepared`.

    Everything is computed from the quantised vertices, so that all arrays describe exactly the same surface.

    Raises:
        MeshError: the mesh has no faces, no extent or no area.
    """
    frame = UnitFrame.of(mesh.vertices, mesh.faces)
    used, faces = np.unique(mesh.faces, return_inverse=True)
    packed = quantise(frame.to_unit(mesh.vertices[used]))
    arrays: dict[str, NDArray[Any]] = {"vertices": packed, "faces": faces.reshape(-1, 3).astype(np.int32)}
    vertices = dequantise(packed).astype(np.float64)
    UnitFrame.of(vertices, arrays["faces"])  # quantisation must not have flattened it
    if options.mesh_only:
        return arrays
    samples, _ = sample_surface(vertices, arrays["faces"], options.samples, seed=0)
    arrays["samples"] = quantise(np.random.default_rng(0).permutation(samples))
    arrays["voxels"] = np.packbits(voxelize(vertices, arrays["faces"], options.resolution).ravel())
    ticks = (np.arange(options.resolution) + 0.5) / options.resolution - 0.5
    centres = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    arrays["closest"] = quantise(SurfaceIndex(vertices, arrays["faces"]).closest(centres)[0])
    return arrays


def _finish(out: Path, results: list[dict[str, Any]], options: Options) -> Summary:
    kept = [result for result in results if result["shapes"]]
    shapes = [shape for result in kept for shape in result["shapes"]]
    skipped = [entry for result in results for entry in result["skipped"]]
    _write_csv(out / "shapes.csv", shapes, ["name", "source", "category", "vertices", "faces", "licence", "split"])
    _write_csv(out / "skipped.csv", skipped, ["name", "reason"])
    digest = hashlib.sha256("".join(result["sha256"] for result in kept).encode()).hexdigest()
    manifest = {
        "version": FORMAT_VERSION,
        **asdict(options),
        "shapes": len(shapes),
        "skipped": len(skipped),
        "sha256": digest,
        "shards": [{"name": r["name"], "shapes": len(r["shapes"]), "sha256": r["sha256"]} for r in kept],
    }
    (out / "manifest.json").write_text(json.dumps(manifest, indent=1))
    return Summary(len(shapes), len(skipped), digest)


def _write_csv(path: Path, rows: list[dict[str, Any]], columns: list[str]) -> None:
    with path.open("w", newline="") as lines:
        out = csv.DictWriter(lines, columns)
        out.writeheader()
        out.writerows(rows)
