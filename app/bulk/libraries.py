"""The libraries of the extra ``bulk`` that come without type information: everything goes through these names."""

from importlib import import_module
from typing import Any

pa: Any = import_module("pyarrow")
parquet: Any = import_module("pyarrow.parquet")
dataset: Any = import_module("pyarrow.dataset")
filesystems: Any = import_module("pyarrow.fs")


def fsspec(module: str) -> Any:
    """A module of fsspec: not every file system needs it, and it takes a while."""
    return import_module(f"fsspec.{module}")
