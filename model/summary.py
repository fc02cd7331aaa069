"""How results show themselves in a REPL and in a notebook: one line, and a table."""

import html
from collections.abc import Iterable, Sequence
from typing import Any

_COLUMNS = ("", "normal or direction", "offset", "order", "error", "rms distance", "exact")


class SymmetrySummary:
    """Short ``repr`` and an HTML table for a result with ``planes``, ``axes`` and ``point_group``.

    Works for the library's `model.Detection` and the service's `app.DetectResponse` alike.
    """

    __slots__ = ()

    # Read through Any: the two kinds of result share the names, not a type.
    def __repr__(self) -> str:
        result: Any = self
        planes, axes = result.planes, result.axes
        exact = sum(bool(found.exact) for found in (*planes, *axes))
        name = _filename(result)
        parts = [
            f"{type(self).__name__} {name}".rstrip() + f": {result.point_group}",
            _count(len(planes), "plane", "planes"),
            _count(len(axes), "axis", "axes"),
        ]
        if planes or axes:
            parts.append(f"{exact} of {len(planes) + len(axes)} exact")
        if result.warnings:
            parts.append(_count(len(result.warnings), "warning", "warnings"))
        return f"<{', '.join(parts)}>"

    def __str__(self) -> str:
        return repr(self)

    def _repr_html_(self) -> str:
        result: Any = self
        rows = [_row("plane", plane.normal, f"{plane.offset + 0.0:.6g}", "", plane) for plane in result.planes]
        rows += [_row("axis", axis.direction, "", str(axis.order or "any angle"), axis) for axis in result.axes]
        head = _cells("th", _COLUMNS)
        body = "".join(_cells("td", row) for row in rows)
        name = html.escape(_filename(result))
        title = f"{name} point group <b>{html.escape(result.point_group)}</b>".strip()
        notes = "".join(f"<p>{html.escape(warning)}</p>" for warning in result.warnings)
        return f"<p>{title}</p><table><thead>{head}</thead><tbody>{body}</tbody></table>{notes}"


def _filename(result: Any) -> str:
    return str(getattr(result.mesh, "filename", ""))


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"


def _row(kind: str, vector: Iterable[float], offset: str, order: str, found: Any) -> Sequence[str]:
    direction = ", ".join(f"{round(float(x), 6) + 0.0:g}" for x in vector)  # + 0.0: no "-0"
    exact = "yes" if found.exact else "predicted" if found.evidence == "predicted" else "no"
    return (kind, f"({direction})", offset, order, f"{found.symmetry_error:.1e}", f"{found.rms_distance:.1e}", exact)


def _cells(tag: str, texts: Iterable[str]) -> str:
    return f"<tr>{''.join(f'<{tag}>{html.escape(text)}</{tag}>' for text in texts)}</tr>"
