"""The decorators that compile numeric loops, and the one array layout they are compiled for.

Compiled code is kept beside the source, as numba does. Three things differ from plain ``numba.njit(cache=True)``: a
cache that can be read but not written (a container image with a read-only root) is used instead of ignored; a place
where nothing can be cached at all costs compile time but is no error; and a kernel is compiled again when any file with
kernels changes, because numba would only look at the kernel's own file and not at those it calls into.
"""

import contextlib
import functools
import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
import numba.extending
import numpy as np
from numba.core import caching  # pyright: ignore[reportUnknownVariableType]

from model.types import AnyArray

_P = ParamSpec("_P")
_R = TypeVar("_R")
# numba ships no type information; everything below that touches it goes through these untyped names.
_njit: Any = numba.njit  # pyright: ignore[reportUnknownMemberType]
_caching: Any = caching

intrinsic: Any = numba.extending.intrinsic  # pyright: ignore[reportUnknownMemberType]
"""Of a function of kernels that is given as instructions, see ``model._lanes``."""


@functools.cache
def _kernel_sources() -> str:
    """Hash of all files of this package that hold kernels."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        content = path.read_bytes()
        if b"model._jit" in content:
            digest.update(content)
    return digest.hexdigest()


class _ReadableLocator(_caching.InTreeCacheLocator):
    """Finds kernels compiled earlier in a ``__pycache__`` that cannot be written now."""

    def ensure_cache_path(self) -> None:
        directory = Path(self.get_cache_path())
        stem = Path(self._py_file).stem
        if not any(directory.glob(f"{stem}.*-{self._lineno}.*.nbi")):
            raise OSError("nothing was compiled here before")


class _Implementation(_caching.CompileResultCacheImpl):
    _locator_classes = (
        _caching.UserProvidedCacheLocator,
        _caching.InTreeCacheLocator,
        _ReadableLocator,
        _caching.UserWideCacheLocator,
    )


class _TolerantCache(_caching.FunctionCache):
    """A cache whose damage or absence means compiling again, never an error."""

    _impl_class = _Implementation

    def __init__(self, py_func: Any) -> None:
        parent: Any = super()
        parent.__init__(py_func)
        self._cache_file._source_stamp = (self._cache_file._source_stamp, _kernel_sources())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        parent: Any = super()
        try:
            return parent.load_overload(sig, target_context)
        except Exception:  # unpickling damaged files can raise anything
            with contextlib.suppress(OSError):
                parent.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        parent: Any = super()
        with contextlib.suppress(OSError):
            parent.save_overload(sig, data)


def jit(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a kernel at its first call; the GIL is released while it runs.

    The kernel may not allocate arrays. In return references to arrays are not counted: otherwise every call of a small
    helper would cost some atomic increments, which slowed the text readers 2 to 17 times. IEEE arithmetic is kept (no
    fast-math), except that a division by zero gives an infinity instead of an exception.
    """
    return _compile(function, _nrt=False)


def jit_inlined(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Like ``jit``, for a small helper of the innermost loops: it becomes part of every kernel that calls it."""
    return _compile(function, _nrt=False, forceinline=True)


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
    if type(values) is np.ndarray and values.dtype == dtype and values.flags.carray:
        return values  # what nearly all are, and hundreds a detection
    return np.require(values, dtype=dtype, requirements=("C", "W", "A"))
