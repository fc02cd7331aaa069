"""ABC: chunks of numbered folders, ``00000000/00000000_HASH_trimesh_000.obj``, side by side or each in its own folder.

The numbers say nothing of what a model is: there are no categories, and no official split.
"""

import re
from pathlib import Path

from training.layouts._files import SourceFile, mesh_files, path_name

_MODEL = re.compile(r"\d{8}_[0-9a-f]+_trimesh_\d+")


def recognises(root: Path) -> bool:
    """Whether there is a numbered folder with a model in it, in the root or one below it."""
    return any(
        _MODEL.fullmatch(path.stem) is not None
        for pattern in ("*/*_trimesh_*.*", "*/*/*_trimesh_*.*")
        for path in root.glob(pattern)
    )


def meshes(root: Path) -> list[SourceFile]:
    """Every triangle mesh; what else a chunk may hold (features, metadata) is passed over."""
    return [
        SourceFile(path, path_name(root, parts), "ABC", "")
        for path, parts in mesh_files(root)
        if _MODEL.fullmatch(path.stem)
    ]
