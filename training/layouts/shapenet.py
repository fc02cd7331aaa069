"""ShapeNetCore.v2: ``SYNSET/MODEL/models/model_normalized.obj``, the official split in ``all.csv`` at the root."""

import csv
from pathlib import Path

from training.layouts._files import SourceFile, mesh_files

_SYNSET_DIGITS = 8


def recognises(root: Path) -> bool:
    """Whether a model is where the published archive has it."""
    return any(root.glob("*/*/models/model_normalized.obj"))


def meshes(root: Path) -> list[SourceFile]:
    """One shape a model, named ``SYNSET/MODEL``, the synset its category; its other files are passed over."""
    splits = _splits(root / "all.csv")
    found: list[SourceFile] = []
    for path, parts in mesh_files(root):
        if len(parts) >= 4 and parts[-2] == "models" and path.stem == "model_normalized":
            synset, model = parts[-4], parts[-3]
            split = splits.get((synset, model), "")
            found.append(SourceFile(path, f"{synset}/{model}", "ShapeNetCore.v2", synset, split=split))
    return found


def _splits(path: Path) -> dict[tuple[str, str], str]:
    """The official split by synset and model; the file has lost the leading zeros of the synsets."""
    if not path.is_file():
        return {}
    with path.open(newline="", encoding="utf-8") as lines:
        return {(row["synsetId"].zfill(_SYNSET_DIGITS), row["modelId"]): row["split"] for row in csv.DictReader(lines)}
