"""One row a plane or axis, for spreadsheets and data frames."""

import csv
import io
from collections.abc import Sequence

from app.outputs.output_format import Options, OutputFormat
from app.schemas import Axis, DetectResponse, Plane

COLUMNS = (
    "file", "point_group", "kind", "index", "x", "y", "z", "offset", "px", "py", "pz", "order", "continuous", "exact",
    "symmetry_error", "rms_distance", "evidence",
)  # fmt: skip
"""x, y, z are a plane's normal or an axis's direction; px, py, pz a point on it; all in input coordinates. ``order`` is
empty for planes and for continuous axes, ``offset`` for axes."""


def rows(response: DetectResponse) -> list[list[object]]:
    """The rows of one mesh; one without symmetries has one row that says so, with ``kind`` none."""
    start = [response.mesh.filename, response.point_group]
    found = [
        *(
            [*start, "plane", i, *plane.normal, plane.offset, *_rest(plane, "")]
            for i, plane in enumerate(response.planes)
        ),
        *([*start, "axis", i, *axis.direction, "", *_rest(axis, axis.order)] for i, axis in enumerate(response.axes)),
    ]
    return found or [[*start, "none", *[""] * (len(COLUMNS) - 3)]]


def _rest(found: Plane | Axis, order: object) -> list[object]:
    flags = ["yes" if flag else "no" for flag in (found.continuous, found.exact)]
    errors = [found.symmetry_error, found.rms_distance]
    return [*found.point, "" if order is None else order, *flags, *errors, found.evidence]


def write(responses: Sequence[DetectResponse]) -> bytes:
    """A table with a heading, RFC 4180, UTF-8."""
    text = io.StringIO(newline="")
    table = csv.writer(text)
    table.writerow(COLUMNS)
    for response in responses:
        table.writerows(rows(response))
    return text.getvalue().encode()


def _write_one(response: DetectResponse, options: Options) -> bytes:
    return write([response])


def _write_all(responses: Sequence[tuple[str, DetectResponse]], options: Options) -> bytes:
    return write([response for _, response in responses])


FORMAT = OutputFormat(
    "csv",
    "text/csv",
    "`format=csv`: a row a plane or axis.",
    write=_write_one,
    write_all=_write_all,
)
