"""`training heldout`: writes the validation shapes of `fit` as mesh files, for `evaluate` to compare runs on."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model.errors import PRSNetError
from model.geometry.frames import UnitFrame
from training.data.prepared import PreparedSet, ShapeRecord, mesh_at
from training.oracle.known_truth import listed_truth
from training.oracle.truth import Truth, TruthAxis, save
from training.shapes.catalogue import binary_ply

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
    arrays = {name: prepared.arrays(name) for name in ("vertices", "faces", "starts", "planes", "families")}
    shards, rows = prepared.locations()
    parts = [{name: array[shard] for name, array in arrays.items()} for shard in range(len(prepared.shards))]
    known: dict[str, Truth] = {}
    for index in chosen.tolist():
        part, row = parts[shards[index]], int(rows[index])
        vertices, faces = mesh_at(part, row)
        try:
            frame = UnitFrame.of(vertices, faces)
        except PRSNetError:  # quantised to nothing
            continue
        file = folder / _file_name(prepared.shapes[index])
        file.write_bytes(binary_ply(vertices, faces))
        known[f"{folder.name}/{file.name}"] = _truth(frame, part["planes"][row], part["families"][row])
    settings = {"labels": prepared.labels["options"], "validation_share": share}
    save(folder / TRUTH_FILE, known, settings, prepared.sha256)
    return len(known)


def _file_name(shape: ShapeRecord) -> str:
    name = shape.name.replace("/", "__")
    return name if name.endswith(".ply") else f"{name}.ply"


def _truth(frame: UnitFrame, planes: NDArray[np.float32], family: NDArray[np.float32]) -> Truth:
    """The labels of one shape, ``(k, 5)`` and ``(6,)``, as ground truth; a continuous axis counts as exact."""
    found = planes[np.isfinite(planes[:, 4])].astype(np.float64)
    axis = family.astype(np.float64)
    axes = [TruthAxis(axis[:3], axis[3:], None, 0.0)] if axis[:3].any() else []
    return listed_truth(frame, found[:, :4], found[:, 4], axes)
