"""ModelNet10 and ModelNet40: ``CLASS/train/*.off`` and ``CLASS/test/*.off``."""

from pathlib import Path

from training.layouts._files import SourceFile, mesh_files, path_name

_SPLITS = ("train", "test")


def recognises(root: Path) -> bool:
    """Whether classes are divided into train and test."""
    return all(any(root.glob(f"*/{split}/*.off")) for split in _SPLITS)


def meshes(root: Path) -> list[SourceFile]:
    """Every OFF file, the class its category, the folder its split."""
    return [
        SourceFile(path, path_name(root, parts), root.name, parts[0], split=parts[1])
        for path, parts in mesh_files(root)
        if len(parts) == 3 and parts[1] in _SPLITS and path.suffix.lower() == ".off"
    ]
