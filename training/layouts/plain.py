"""Plain folders: the root is the source, the first folder below it the category."""

from pathlib import Path

from training.layouts._files import SourceFile, mesh_files, path_name


def recognises(root: Path) -> bool:
    """Any folder will do."""
    return True


def meshes(root: Path) -> list[SourceFile]:
    """Every mesh file below the root."""
    return [
        SourceFile(path, path_name(root, parts), root.name, parts[0] if len(parts) > 1 else "")
        for path, parts in mesh_files(root)
    ]
