"""The one decorator that compiles numeric loops, and the one array layout they are compiled for.

Compiled code is kept beside the source, as numba does. Two things differ from plain ``numba.njit(cache=True)``: a cache
that can be read but not written (a container image with a read-only root) is used instead of ignored, and a place where
nothing can be cached at all costs compile time but is no error.

A cached kernel is rebuilt when *its own* file changes, not when a file it calls into does. Hence the rule: a kernel calls
only kernels of its own module.
"""

import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
import numpy as np
from numba.core import caching

from model.types import AnyArray

_P = ParamSpec("_P")
_R = TypeVar("_R")
# numba ships no type information; everything below that touches it goes through these untyped names.
_njit: Any = numba.njit  # pyright: ignore[reportUnknownMemberType]
_caching: Any = caching


class _ReadableLocator(_caching.InTreeCacheLocator):
    """Finds kernels compiled earlier in a ``__pycache__`` that cannot be written now."""

    def ensure_cache_path(self) -> None:
        directory = Path(self.get_cache_path())
        stem = Path(self._py_file).stem
        if not any(directory.glob(f"{stem}.*-{self._lineno}.*.nbi")):
            raise OSError("nothing was compiled here before")


class _Implementation(_caching.CompileResultCacheImpl):
    _locator_classes = [
        _caching.UserProvidedCacheLocator,
        _caching.InTreeCacheLocator,
        _ReadableLocator,
        _caching.UserWideCacheLocator,
    ]


class _TolerantCache(_caching.FunctionCache):
    """A cache whose damage or absence means compiling again, never an error."""

    _impl_class = _Implementation

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except (OSError, EOFError, pickle.UnpicklingError):
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except OSError:
            return


def jit(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a kernel at its first call; the GIL is released while it runs.

    The kernel may not allocate arrays. In return references to arrays are not counted: otherwise every call of a small
    helper would cost some atomic increments, which slowed the readers ten times. IEEE arithmetic is kept (no fast-math),
    except that a division by zero gives an infinity instead of an exception.
    """
    return _compile(function, _nrt=False)


def jit_allocating(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Like ``jit``, for a kernel that creates arrays."""
    return _compile(function)


def _compile(function: Callable[_P, _R], **options: bool) -> Callable[_P, _R]:
    compiled = _njit(nogil=True, fastmath=False, error_model="numpy", **options)(function)
    if os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0"):
        try:
            compiled._cache = _TolerantCache(function)
        except RuntimeError:  # no directory at all, not even a readable one
            return compiled
    return compiled


def kernel_array(values: Any, dtype: Any) -> AnyArray:
    """The values as a C-contiguous, writable array of ``dtype``; copied only if they are not one already.

    Kernels are compiled per memory layout: passing all arrays through here keeps that to one compilation each.
    """
    return np.require(values, dtype=dtype, requirements=("C", "W", "A"))
