"""The Arrow libraries. They come without type information, so everything goes through these names."""

from importlib import import_module
from typing import Any

pa: Any = import_module("pyarrow")
parquet: Any = import_module("pyarrow.parquet")
dataset: Any = import_module("pyarrow.dataset")
filesystems: Any = import_module("pyarrow.fs")
