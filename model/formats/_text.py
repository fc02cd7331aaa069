"""Numbers out of text at native speed, for the ASCII formats."""

import re

import numpy as np

from model._jit import jit
from model.types import AnyArray, ByteArray, FloatArray

# Those up to 1e22 are exact; a number of up to 15 digits times or over one of them is rounded correctly.
_POWERS = np.array([float(f"1e{exponent}") for exponent in range(309)])

_DECIMAL_COMMA = re.compile(rb"(?:^|[ \t])[-+]?[0-9]+,[0-9]+(?:[eE][-+]?[0-9]+)?(?=[ \t\r\n]|\Z)", re.MULTILINE)


_WIDE = (b"\xff\xfe", b"\xfe\xff")


def as_bytes(data: bytes) -> ByteArray:
    """The bytes as an array, without a copy and without a byte-order mark."""
    array = np.frombuffer(data, dtype=np.uint8)
    return array[3:] if data[:3] == b"\xef\xbb\xbf" else array


def narrow(data: bytes) -> bytes:
    """Text of 16 bits a letter, as some systems write it and its first two bytes tell, as UTF-8; other data as is.

    A mark at the beginning that only tells the encoding is left out.
    """
    if data[:3] == b"\xef\xbb\xbf":
        return data[3:]
    if data[:2] not in _WIDE:
        return data
    try:
        text = data.decode("utf-16").encode()
    except UnicodeDecodeError:
        return data
    return data if b"\0" in text[:1024] else text


def unix_lines(data: bytes) -> bytes:
    """Text whose lines end in carriage returns, as old systems wrote it, with line feeds; other text as it is."""
    if b"\r" not in data:  # far quicker to ask than how often
        return data
    returns = data.count(b"\r")
    if returns - data.count(b"\r\n") > data.count(b"\n"):
        return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return data


DECIMAL_COMMAS = (
    "The numbers of the file seem to have decimal commas, as some programs write them in some countries; "
    "export the mesh with decimal points."
)


def has_decimal_commas(data: bytes) -> bool:
    """Whether coordinates near the start of a text are written like 0,5."""
    return _DECIMAL_COMMA.search(data[: 1 << 16]) is not None


def parse_numbers(data: ByteArray, stop_at_junk: bool = False) -> tuple[FloatArray, AnyArray]:
    """All numbers of a text; ``#`` starts a comment that lasts to the end of the line.

    Args:
        data: (n,) the bytes.
        stop_at_junk: whether a token that is no number ends the text; otherwise it reads as NaN.

    Returns:
        (k,) float64 numbers, exact up to 15 digits and within two units in the last place beyond, and (k,) int64
        numbers of the line each stands on.
    """
    room = len(data) // 2 + 1
    numbers, lines = np.empty(room), np.empty(room, dtype=np.int64)
    count = _parse(data, stop_at_junk, numbers, lines)
    return numbers[:count].copy(), lines[:count].copy()


@jit
def parse_number(data: ByteArray, at: int, end: int) -> tuple[float, int]:
    """The number that starts at `at` and the place after it; that place is `at` if there is no number.

    Takes an optional sign, digits with an optional point, an optional exponent (e, E, d or D), and the words inf and
    nan in the spellings C prints.
    """
    start = at
    negative = False
    if at < end and (data[at] == 45 or data[at] == 43):
        negative = data[at] == 45
        at += 1
    mantissa, digits, exponent = np.uint64(0), 0, 0
    seen, point = False, False
    while at < end:
        byte = data[at]
        if 48 <= byte <= 57:
            seen = True
            if digits < 19:
                mantissa = mantissa * np.uint64(10) + np.uint64(byte - 48)
                digits += mantissa > np.uint64(0)
                exponent -= point
            else:
                exponent += not point
        elif byte == 46 and not point:
            point = True
        else:
            break
        at += 1
    if not seen:
        return _parse_word(data, start, at, end, negative)
    if at < end and (data[at] | 32 == 101 or data[at] | 32 == 100):
        place = at + 1
        down = False
        if place < end and (data[place] == 45 or data[place] == 43):
            down = data[place] == 45
            place += 1
        power, found = 0, False
        while place < end and 48 <= data[place] <= 57:
            power = min(power * 10 + int(data[place] - 48), 100000)
            found = True
            place += 1
        if found:
            exponent += -power if down else power
            at = place
    value = float(mantissa)
    if value > 0.0:
        if exponent >= 0:
            value = value * _POWERS[exponent] if exponent <= 308 else np.inf
        else:
            value /= _POWERS[min(-exponent, 308)]
            if exponent < -308:
                value /= _POWERS[min(-exponent - 308, 308)]
    return -value if negative else value, at


@jit
def _parse_word(data: ByteArray, start: int, at: int, end: int, negative: bool) -> tuple[float, int]:
    """nan, inf or infinity after an optional sign."""
    if at + 3 <= end:
        a, b, c = data[at] | 32, data[at + 1] | 32, data[at + 2] | 32
        if a == 110 and b == 97 and c == 110:
            return np.nan, at + 3
        if a == 105 and b == 110 and c == 102:
            at += 3
            if at + 5 <= end and data[at] | 32 == 105 and data[at + 4] | 32 == 121:
                at += 5
            return -np.inf if negative else np.inf, at
    return np.nan, start


@jit
def _parse(data: ByteArray, stop_at_junk: bool, numbers: FloatArray, lines: AnyArray) -> int:
    at, count, line = 0, 0, 0
    end = data.shape[0]
    while at < end:
        byte = data[at]
        if byte == 10:
            line += 1
            at += 1
        elif byte <= 32:
            at += 1
        elif byte == 35:
            while at < end and data[at] != 10:
                at += 1
        else:
            value, after = parse_number(data, at, end)
            if after == at or (after < end and data[after] > 32 and data[after] != 35):
                if stop_at_junk:
                    return count
                value = np.nan
                while after < end and data[after] > 32:
                    after += 1
            numbers[count], lines[count] = value, line
            count += 1
            at = after
    return count
