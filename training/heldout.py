"""`training heldout`: the shapes that `fit` validates with as mesh files, for `evaluate` to judge runs on them."""

from pathlib import Path

import numpy as np

from model.errors import PRSNetError
from model.frames import UnitFrame
from model.types import FloatArray, IntArray
from training.known_truth import planes_through
from training.prepared import PreparedSet, ShapeRecord, dequantise
from training.shapes import binary_ply
from training.truth import Truth, TruthAxis, save

TRUTH_FILE = "truth.json"


def write_held_out(prepared: PreparedSet, folder: Path, share: float, limit: int | None = None) -> int:
    """Write the held-out shapes of a prepared set as PLY files, and their labels as ground truth beside them.

    They are the shapes as prepared: in the unit frame, with faces and precision of the set. What is chosen on them is
    chosen without the test split.

    Args:
        prepared: the set, labelled by `training label`.
        folder: where ``NAME.ply`` and ``truth.json`` go; made if missing.
        share: as in the recipe (``validation_share``).
        limit: write the first so many, in an order that does not depend on their names' alphabet.

    Returns:
        the number of shapes written.

    Raises:
        ValueError: the set has no labels, or nothing is held out.
    """
    if prepared.labels is None:
        raise ValueError(f"{prepared.root} has no labels; run `training label` first")
    _, held_out = prepared.split(share)
    if not len(held_out):
        raise ValueError(f"nothing of {prepared.root} is held out at a share of {share}")
    chosen = np.random.default_rng(0).permutation(held_out)[:limit]
    folder.mkdir(parents=True, exist_ok=True)
    sizes = [entry["shapes"] for entry in prepared.manifest["shards"]]
    ends = np.cumsum(sizes)
    known: dict[str, Truth] = {}
    for index in chosen.tolist():
        shard = int(np.searchsorted(ends, index, side="right"))
        vertices, faces, planes, family = _arrays(prepared.shards[shard], index - int(ends[shard]) + sizes[shard])
        try:
            frame = UnitFrame.of(vertices, faces)
        except PRSNetError:  # quantised to nothing
            continue
        file = folder / _file_name(prepared.shapes[index])
        file.write_bytes(binary_ply(vertices, faces))
        known[f"{folder.name}/{file.name}"] = _truth(frame, planes, family)
    settings = {"labels": prepared.labels["options"], "validation_share": share}
    save(folder / TRUTH_FILE, known, settings, prepared.sha256)
    return len(known)


def _file_name(shape: ShapeRecord) -> str:
    name = shape.name.replace("/", "__")
    return name if name.endswith(".ply") else f"{name}.ply"


def _arrays(shard: Path, row: int) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    """Vertices ``(v, 3)`` float64, faces ``(f, 3)``, planes ``(k, 5)`` and family ``(6,)`` of one shape of a shard."""
    starts = np.load(shard / "starts.npy", mmap_mode="r")
    (v0, f0), (v1, f1) = starts[row], starts[row + 1]
    vertices = dequantise(np.load(shard / "vertices.npy", mmap_mode="r")[v0:v1]).astype(np.float64)
    faces = np.ascontiguousarray(np.load(shard / "faces.npy", mmap_mode="r")[f0:f1])
    planes = np.load(shard / "planes.npy", mmap_mode="r")[row].astype(np.float64)
    return vertices, faces, planes, np.load(shard / "families.npy", mmap_mode="r")[row].astype(np.float64)


def _truth(frame: UnitFrame, planes: FloatArray, family: FloatArray) -> Truth:
    """The labels of one shape as ground truth; a continuous axis counts as exact, like the two planes through it."""
    found = planes[np.isfinite(planes[:, 4])]
    axes = [TruthAxis(family[:3], family[3:], None, 0.0)] if family[:3].any() else []
    through = planes_through(axes[0]) if axes else []
    return Truth(
        center=frame.center,
        scale=frame.scale,
        planes=np.concatenate([found[:, :4], np.reshape(through, (-1, 4))]),
        plane_errors=np.concatenate([found[:, 4], np.zeros(len(through))]),
        plane_continuous=np.array([False] * len(found) + [True] * len(through), dtype=np.bool_),
        axes=axes,
    )
