"""What training draws from a prepared set: the same from files as from memory, and without loading the set."""

import resource
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import torch

from model.geometry.surface import SurfaceIndex
from training.data import mapped
from training.data import prepare as module
from training.data.mapped import MappedArrays
from training.data.prepare import Options, prepare
from training.data.prepared import PreparedSet
from training.data.store import ResidentArrays, ShapeStore

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def shards(mesh_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> PreparedSet:
    """The shapes in shards of 20."""
    out = tmp_path_factory.mktemp("shards")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "SHARD_SHAPES", 20)
        prepare([mesh_folder], out, Options(samples=1000, resolution=16), progress=False)
    return PreparedSet(out)


def test_files_and_memory_give_the_same(shards: PreparedSet):
    files, memory = MappedArrays(shards, CPU, 16, None), ResidentArrays(shards, CPU, 16, None)
    shapes = torch.tensor([95, 0, 41, 20, 19, 41])
    one, other = files.meshes(shapes), memory.meshes(shapes)
    assert torch.equal(one.corners, other.corners)
    assert torch.equal(one.shape, other.shape)
    assert one.size == other.size == 6
    generator = torch.Generator().manual_seed(0)
    window = torch.randint(0, 1000, (6, 50), generator=generator)
    assert torch.equal(files.samples(shapes, window), memory.samples(shapes, window))
    cells = torch.randint(0, 16**3, (6, 200), generator=generator)
    assert torch.equal(files.closest(shapes, cells), memory.closest(shapes, cells))
    assert files.stored_samples == memory.stored_samples == 1000


def test_the_set_is_not_loaded(prepared: PreparedSet):
    """A batch of four takes a small part of the memory that the arrays would."""
    whole = sum(array.nbytes for name in ("samples", "closest") for array in prepared.arrays(name))
    tracemalloc.start()
    store = ShapeStore(prepared, CPU, 32)
    shapes = torch.arange(4) * 20
    samples = store.draw_samples(shapes, 500, torch.Generator().manual_seed(1))
    store.meshes(shapes)
    store.closest(shapes, samples)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert whole > 15e6
    assert peak < 0.1 * whole


def test_derived_arrays_are_kept_for_the_next_run(mesh_folder: Path, tmp_path: Path):
    prepare([mesh_folder / "box"], tmp_path, Options(mesh_only=True), progress=False)
    bare = PreparedSet(tmp_path)
    calls: list[tuple[int, int]] = []
    first = ShapeStore(bare, CPU, 16, lambda done, total: calls.append((done, total)))
    assert calls[-1] == (16, 16)
    calls.clear()
    second = ShapeStore(bare, CPU, 16, lambda done, total: calls.append((done, total)))
    assert not calls
    shapes = torch.arange(3)
    generators = [torch.Generator().manual_seed(5) for _ in range(2)]
    drawn = [store.draw_samples(shapes, 100, g) for store, g in zip((first, second), generators, strict=True)]
    assert torch.equal(*drawn)
    # The samples lie on the surface, and the closest points are of it and near the points asked for.
    vertices = np.array(bare.arrays("vertices")[0], dtype=float) / 65535 - 0.5
    for index in range(3):
        (v0, f0), (v1, f1) = bare.arrays("starts")[0][index : index + 2]
        surface = SurfaceIndex(vertices[v0:v1], np.array(bare.arrays("faces")[0][f0:f1]))
        assert surface.squared_distances(drawn[0][index].double().numpy()).max() < 1e-8
        found = second.closest(shapes[index : index + 1], drawn[0][index : index + 1])[0]
        assert surface.squared_distances(found.double().numpy()).max() < 1e-8
        assert (found - drawn[0][index]).norm(dim=1).max() < 2 * 3**0.5 / 16


def test_the_limit_on_open_files_is_raised():
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    if limits[1] != resource.RLIM_INFINITY and limits[1] < 1200:
        pytest.skip("the hard limit is too low")
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (400, limits[1]))
        mapped._allow_files(900)
        assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] >= 900
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
