"""What threads need that make parts of an array they share: each part is made by one of them, and seen whole by all.

A part has a place in an array of integers (int32): 0 until a thread claims it, -1 while that makes it, then what the
maker publishes, which is positive.
"""

from typing import Any

from llvmlite import ir  # pyright: ignore[reportMissingTypeStubs]
from numba.core import cgutils, types  # pyright: ignore[reportUnknownVariableType]

from model._jit import intrinsic, jit
from model.types import IntArray

_ir: Any = ir
_cgutils: Any = cgutils
_types: Any = types

_INDEX: Any = _types.int64
_NUMBER: Any = _ir.IntType(32)


def _pointer(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    return builder.gep(_cgutils.create_struct_proxy(kind)(context, builder, array).data, [index])


@intrinsic
def claim(typing: Any, places: Any, index: Any) -> Any:
    """``claim(places, index)``: whether the caller is the one that makes a part; it then has to `publish` it."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = _pointer(context, builder, signature.args[0], *arguments)
        free, claimed = _ir.Constant(_NUMBER, 0), _ir.Constant(_NUMBER, -1)
        result = builder.cmpxchg(place, free, claimed, "acq_rel", "acquire")
        return builder.extract_value(result, 1)

    return _types.boolean(places, _INDEX), generate


@intrinsic
def publish(typing: Any, places: Any, index: Any, number: Any) -> Any:
    """``publish(places, index, number)``: what was written before is seen by whoever sees the number."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = _pointer(context, builder, signature.args[0], *arguments[:2])
        builder.store_atomic(builder.trunc(arguments[2], _NUMBER), place, "release", 4)
        return context.get_dummy_value()

    return _types.void(places, _INDEX, _INDEX), generate


@intrinsic
def published(typing: Any, places: Any, index: Any) -> Any:
    """``published(places, index)``: the number of a part; 0 or less if it is not made."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = _pointer(context, builder, signature.args[0], *arguments)
        return builder.sext(builder.load_atomic(place, "acquire", 4), _ir.IntType(64))

    return _INDEX(places, _INDEX), generate


@intrinsic
def take(typing: Any, counters: Any, index: Any) -> Any:
    """``take(counters, index)``: the value of a counter, which the next caller finds one higher."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = _pointer(context, builder, signature.args[0], *arguments)
        before = builder.atomic_rmw("add", place, _ir.Constant(_NUMBER, 1), "monotonic")
        return builder.sext(before, _ir.IntType(64))

    return _INDEX(counters, _INDEX), generate


@jit
def wait_for(places: IntArray, index: int) -> int:
    """The number of a part that another thread is making: it takes less than a microsecond."""
    number = 0
    while number <= 0:
        number = published(places, index)
    return number
