"""After the warm-up no request waits for a compiler."""

import subprocess
import sys
from pathlib import Path

import pytest
import trimesh

from app.outputs.registry import MESH_WRITERS
from app.workers.warmup import sample_clouds, sample_files
from benchmarks.meshes import SHAPES
from model.formats import read_mesh
from tests.app.fakes import DATA
from tests.model.formats.test_point_clouds import FILES as CLOUDS

ROOT = DATA.parents[1]
# Runs in a process of its own, because kernels stay loaded. Prints the kernels that had not been warmed up.
LATE_KERNELS = """
import importlib, pkgutil, sys
import numpy as np
import model
from app.detection import MeshLimits, Options, parse_and_detect
from app.workers.warmup import warm_up
from model import Detector
from model.completion.halving import halve
from model.completion.mirroring import complete
from model.formats.reading import read_mesh

def kernels():
    names = [module.name for module in pkgutil.walk_packages(model.__path__, "model.")]
    return {
        f"{module}.{name}": list(value.signatures)
        for module in names
        for name, value in vars(importlib.import_module(module)).items()
        if hasattr(value, "signatures")
    }

detector = Detector.load()
warm_up(detector)
before = kernels()
assert any(before.values())
modules = set(sys.modules)
contents = {path: open(path, "rb").read() for path in sys.argv[1:]}
opened = []
sys.addaudithook(lambda event, arguments: opened.append(str(arguments[0])) if event == "open" else None)
for path, content in contents.items():
    for mode in ("full", "paper"):
        options = Options(mode, include=("rejected", "bop"))
        parse_and_detect(detector, content, path, options, MeshLimits())
    if path.endswith((".obj", ".stl", ".glb")):
        mesh = read_mesh(content, path)
        plane = np.append([0.6, 0.0, 0.8], -np.mean(mesh.bounds, axis=0) @ [0.6, 0.0, 0.8])
        for symmetrize in (False, True):
            complete(mesh, plane, symmetrize=symmetrize)
        halve(mesh, plane)
        halve(mesh, plane, capped=True)
text = b"mtllib a.mtl\\nv 0 0 0\\nv 1 0 0\\nv 0 1 0\\nvt 0 1\\nusemtl b\\nf 1/1 2/1 3/1\\n"
files = {"a.mtl": b"newmtl b\\nmap_Kd b.png\\n", "b.png": b"\\x89PNG\\r\\n\\x1a\\n"}
assert read_mesh(text, "a.obj", resources=files.get, looks=True).texture is not None
opened = [path for path in opened if "__pycache__" not in path]  # of kernels, told below
print(opened, sorted(set(sys.modules) - modules), end=" ")
print([name for name, signatures in kernels().items() if signatures != before[name]])
"""


@pytest.mark.parametrize(("name", "data"), sample_files(), ids=[name for name, _ in sample_files()])
def test_every_sample_is_the_same_box(name: str, data: bytes) -> None:
    mesh = read_mesh(data, name)
    assert mesh.bounds.tolist() == [[0, 0, 0], [1, 2, 3]]
    assert len(mesh.faces) == 12
    assert mesh.watertight
    assert mesh.area == pytest.approx(22)


@pytest.mark.parametrize(("name", "data"), sample_clouds(), ids=[name for name, _ in sample_clouds()])
def test_every_sample_cloud_is_that_box(name: str, data: bytes) -> None:
    mesh = read_mesh(data, name)
    assert mesh.kind == "points"
    assert mesh.bounds.tolist() == [[0, 0, 0], [1, 2, 3]]
    assert len(mesh.vertices) == 90


def nested() -> bytes:
    """A box in a box."""
    parts = [trimesh.creation.box((4, 2, 2)), trimesh.creation.box((1, 1, 0.5))]
    return trimesh.util.concatenate(parts).export(file_type="stl")


def test_real_files_need_no_further_file_module_or_kernel(tmp_path: Path) -> None:
    """Open, crossing, thin and scattered surfaces among them, and clouds of every format."""
    for name, shape in SHAPES.items():
        (tmp_path / f"{name}.stl").write_bytes(MESH_WRITERS["stl"].file(*shape(600)))
    (tmp_path / "nested.stl").write_bytes(nested())
    for kind, (extension, data) in CLOUDS.items():
        (tmp_path / f"{kind}.{extension}").write_bytes(data)
    found = [*DATA.iterdir(), *tmp_path.iterdir()]
    files = sorted(str(path) for path in found if path.suffix != ".md")
    command = [sys.executable, "-c", LATE_KERNELS, *files]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=240, check=True)
    # A worker could load neither: it opens no file.
    assert result.stdout.strip() == "[] [] []"
