from pathlib import Path

import numpy as np
import pytest

from tests.shapes import as_mesh, known
from training.data.prepare import Options, prepare
from training.data.prepared import PreparedSet

SMALL = ("box", "mirror", "pyramid", "chair", "table", "none")


def write_obj(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
    lines += [f"f {a} {b} {c}" for a, b, c in faces + 1]
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture(scope="session")
def mesh_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ninety-six low-poly shapes in plain folders, the family as category."""
    root = tmp_path_factory.mktemp("meshes") / "shapes"
    for seed in range(16):
        for family in SMALL:
            mesh = as_mesh(known(family, seed))
            write_obj(root / family / f"{seed:02d}.obj", mesh.vertices, mesh.faces)
    return root


@pytest.fixture(scope="session")
def prepared(mesh_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> PreparedSet:
    out = tmp_path_factory.mktemp("prepared")
    prepare([mesh_folder], out, Options(samples=2048), progress=False)
    return PreparedSet(out)
