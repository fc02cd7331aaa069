"""The kernel cache where nothing can be written: used if it is there, done without if not."""

import importlib.util

import numpy as np
import pytest
from numba.core import caching

from model._jit import kernel_array

SOURCE = """
from model._jit import jit

@jit
def total(values):
    result = 0.0
    for index in range(values.shape[0]):
        result += values[index]
    return result
"""


def load(path):
    spec = importlib.util.spec_from_file_location("kernels_of_a_test", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def kernel_file(tmp_path):
    path = tmp_path / "kernels_of_a_test.py"
    path.write_text(SOURCE)
    return path


@pytest.fixture
def read_only(monkeypatch):
    """No directory can be written, whoever runs the tests."""

    def refuse(self):
        raise OSError("read-only file system")

    for locator in (caching.InTreeCacheLocator, caching.UserProvidedCacheLocator, caching.UserWideCacheLocator):
        monkeypatch.setattr(locator, "ensure_cache_path", refuse)


def test_a_kernel_compiled_before_is_found_in_a_read_only_place(kernel_file, request):
    assert load(kernel_file).total(np.arange(4.0)) == 6
    request.getfixturevalue("read_only")
    again = load(kernel_file).total
    assert again(np.arange(4.0)) == 6
    assert sum(again.stats.cache_hits.values()) == 1
    # Another type has to be compiled, and cannot be kept.
    assert again(np.arange(4)) == 6
    assert sum(again.stats.cache_misses.values()) == 1


@pytest.mark.usefixtures("read_only")
def test_a_place_without_any_cache_only_costs_time(kernel_file):
    assert load(kernel_file).total(np.arange(4.0)) == 6


def test_damaged_cache_files_mean_compiling_again(kernel_file):
    assert load(kernel_file).total(np.arange(4.0)) == 6
    for file in (kernel_file.parent / "__pycache__").glob("*.nb?"):
        file.write_bytes(b"damaged")
    assert load(kernel_file).total(np.arange(4.0)) == 6


def test_kernel_arrays_have_one_layout():
    frozen = np.arange(6.0).reshape(2, 3)
    frozen.flags.writeable = False
    for values in (frozen, frozen.T, frozen[:, ::-1], frozen.tolist(), frozen.astype(np.float32)):
        array = kernel_array(values, np.float64)
        assert array.dtype == np.float64
        assert array.flags.c_contiguous
        assert array.flags.writeable
        assert np.array_equal(array, values)
    own = np.arange(6.0)
    assert kernel_array(own, np.float64) is own
