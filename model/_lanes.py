"""Vector arithmetic for kernels: several numbers at once, written like one.

Numba leaves it to the compiler to find loops that can be done several steps at a time, and for a few steps of fixed
number it finds none. Here the instructions are given: one for each operation, on all lanes. A processor whose vectors
are shorter takes several of them. Every lane is IEEE arithmetic without fusing, so that results are the same to the bit
everywhere, and the same as a loop's.
"""

from typing import Any

from llvmlite import ir  # pyright: ignore[reportMissingTypeStubs]
from numba.core import cgutils, types  # pyright: ignore[reportUnknownVariableType]

from model._jit import intrinsic

_ir: Any = ir
_cgutils: Any = cgutils
_types: Any = types

_DOUBLE, _INDEX = _ir.DoubleType(), _ir.IntType(64)


class Lanes:
    """Numbers (float64), or truth values, that go through the same arithmetic: what an intrinsic is written with."""

    def __init__(self, builder: Any, value: Any, count: int) -> None:
        """``value`` is a vector of ``count`` lanes that instructions of ``builder`` have made."""
        self._builder, self._value, self._count = builder, value, count

    def _of(self, value: Any) -> "Lanes":
        return Lanes(self._builder, value, self._count)

    def _lanes(self, other: "Lanes | float") -> Any:
        if isinstance(other, Lanes):
            return other._value
        return _ir.Constant(_ir.VectorType(_DOUBLE, self._count), [float(other)] * self._count)

    def __add__(self, other: "Lanes | float") -> "Lanes":
        return self._of(self._builder.fadd(self._value, self._lanes(other)))

    def __sub__(self, other: "Lanes | float") -> "Lanes":
        return self._of(self._builder.fsub(self._value, self._lanes(other)))

    def __mul__(self, other: "Lanes | float") -> "Lanes":
        return self._of(self._builder.fmul(self._value, self._lanes(other)))

    def __neg__(self) -> "Lanes":
        return self._of(self._builder.fneg(self._value))

    def __lt__(self, other: "Lanes | float") -> "Lanes":
        return self._of(self._builder.fcmp_ordered("<", self._value, self._lanes(other)))

    def __gt__(self, other: "Lanes | float") -> "Lanes":
        return self._of(self._builder.fcmp_ordered(">", self._value, self._lanes(other)))

    def __ge__(self, other: "Lanes | float") -> "Lanes":
        return self._of(self._builder.fcmp_ordered(">=", self._value, self._lanes(other)))

    def where(self, yes: "Lanes | float", no: "Lanes | float") -> "Lanes":
        """In lanes that are true ``yes``, in others ``no``."""
        return self._of(self._builder.select(self._value, self._lanes(yes), self._lanes(no)))

    def max(self, other: "Lanes | float") -> "Lanes":
        """The larger one."""
        return (self > other).where(self, other)

    def min(self, other: "Lanes | float") -> "Lanes":
        """The smaller one."""
        return (self < other).where(self, other)

    def bits(self) -> Any:
        """A number (int64) with a bit for each lane that is true, the lowest for the first."""
        mask = self._builder.bitcast(self._value, _ir.IntType(self._count))
        return self._builder.zext(mask, _INDEX)

    def store(self, pointer: Any) -> None:
        """Write the lanes behind each other."""
        vector = self._builder.bitcast(pointer, self._value.type.as_pointer())
        self._builder.store(self._value, vector, align=8)


class Memory:
    """An array (float64, one axis, contiguous) as rows of ``count`` lanes, the first row at ``start``."""

    def __init__(self, context: Any, builder: Any, array: tuple[Any, Any], start: Any, count: int) -> None:
        """``array``: its numba type and the value that an intrinsic was given."""
        kind, value = array
        self._builder, self._count = builder, count
        self._first = builder.gep(_cgutils.create_struct_proxy(kind)(context, builder, value).data, [start])

    def row(self, number: int) -> Lanes:
        """The row with a number."""
        vector = _ir.VectorType(_DOUBLE, self._count)
        pointer = self._builder.gep(self._first, [_ir.Constant(_INDEX, number * self._count)])
        value = self._builder.load(self._builder.bitcast(pointer, vector.as_pointer()), align=8)
        return Lanes(self._builder, value, self._count)

    def store(self, lanes: Lanes) -> None:
        """Write the first row."""
        lanes.store(self._first)


def same_in_all(builder: Any, value: Any, count: int) -> Lanes:
    """One number in ``count`` lanes."""
    kind = _ir.VectorType(_DOUBLE, count)
    first = builder.insert_element(_ir.Constant(kind, _ir.Undefined), value, _ir.Constant(_ir.IntType(32), 0))
    shuffle = _ir.Constant(_ir.VectorType(_ir.IntType(32), count), [0] * count)
    return Lanes(builder, builder.shuffle_vector(first, _ir.Constant(kind, _ir.Undefined), shuffle), count)


INDEX: Any = _types.int64
ZERO: Any = _ir.Constant(_INDEX, 0)
TRUE: Any = _ir.Constant(_ir.IntType(1), 1)


@intrinsic
def bits_of(typing: Any, number: Any) -> Any:
    """``bits_of(number)``: the 64 bits of a number (float64), as one (int64)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], _INDEX)

    return INDEX(number), generate
