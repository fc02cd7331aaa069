"""After the warm-up no request waits for a compiler."""

import subprocess
import sys

import pytest

from app.warmup import sample_files
from model.formats import read_mesh

from .fakes import DATA

ROOT = DATA.parents[1]
# Runs in a process of its own, because kernels stay loaded. Prints the kernels that had not been warmed up.
LATE_KERNELS = """
import importlib, pkgutil, sys
import model.formats
from app.warmup import sample_files
from model.formats import read_mesh

def kernels():
    found = pkgutil.iter_modules(model.formats.__path__, "model.formats.")
    names = ["model.mesh", *(module.name for module in found)]
    return {
        f"{module}.{name}": list(value.signatures)
        for module in names
        for name, value in vars(importlib.import_module(module)).items()
        if hasattr(value, "signatures")
    }

for name, data in sample_files():
    read_mesh(data, name)
before = kernels()
assert any(before.values())
for path in sys.argv[1:]:
    read_mesh(open(path, "rb").read(), path)
print([name for name, signatures in kernels().items() if signatures != before[name]])
"""


@pytest.mark.parametrize(("name", "data"), sample_files(), ids=[name for name, _ in sample_files()])
def test_every_sample_is_the_same_box(name: str, data: bytes) -> None:
    mesh = read_mesh(data, name)
    assert mesh.bounds.tolist() == [[0, 0, 0], [1, 2, 3]]
    assert len(mesh.faces) == 12
    assert mesh.watertight
    assert mesh.area == pytest.approx(22)


def test_reading_real_files_needs_no_further_kernel() -> None:
    files = sorted(str(path) for path in DATA.iterdir() if path.suffix != ".md")
    command = [sys.executable, "-c", LATE_KERNELS, *files]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=240, check=True)
    assert result.stdout.strip() == "[]"
