"""The parameter ``symmetry_axes`` of Isaac ROS FoundationPose: rotations about the model's own x, y and z."""

import json
import math
from collections.abc import Sequence

from app.outputs.bop import model_id
from app.outputs.output_format import Options, OutputFormat
from app.schemas import Axis, DetectResponse

_PARALLEL = 1e-4
"""Largest sine between an axis and a coordinate axis that count as one."""


def entry(response: DetectResponse) -> dict[str, object]:
    """``symmetry_axes``: ``z_full`` where every angle is a symmetry, or else each angle in degrees, as ``z_90``.

    ``left_out`` counts the axes that lie along none of x, y and z, which the parameter cannot express.
    """
    found: list[str] = []
    left_out = 0
    for axis in response.axes:
        name = _coordinate(axis)
        if name is None:
            left_out += 1
        elif axis.order is None:
            found.append(f"{name}_full")
        else:
            found += [f"{name}_{360.0 * turn / axis.order:.10g}" for turn in range(1, axis.order)]
    return {"symmetry_axes": sorted(found, key=_order), "left_out": left_out}


def write(response: DetectResponse, options: Options) -> bytes:
    """The entry as UTF-8 JSON."""
    return json.dumps(entry(response)).encode()


def write_all(responses: Sequence[tuple[str, DetectResponse]], options: Options) -> bytes:
    """The entries of several models, by name."""
    return json.dumps({name: entry(response) for name, response in responses}, indent=2).encode()


def _coordinate(axis: Axis) -> str | None:
    for index, name in enumerate("xyz"):
        others = [value for at, value in enumerate(axis.direction) if at != index]
        if math.hypot(*others) < _PARALLEL:
            return name
    return None


def _order(name: str) -> tuple[str, float]:
    axis, _, angle = name.partition("_")
    return axis, 0.0 if angle == "full" else float(angle)


FORMAT = OutputFormat(
    "foundationpose",
    "application/vnd.prsnet.foundationpose+json",
    "`format=foundationpose`, then sent as application/json: `symmetry_axes` as Isaac ROS FoundationPose takes them.",
    write=write,
    write_all=write_all,
    entry_name=model_id,
    query_media_type="application/json",
    schema={
        "type": "object",
        "properties": {
            "symmetry_axes": {"type": "array", "items": {"type": "string"}},
            "left_out": {"type": "integer", "description": "Axes along none of x, y and z."},
        },
    },
)
