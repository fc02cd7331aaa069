"""The text of SHREC's symmetry tracks: how many planes, then ``nx ny nz px py pz confidence`` a line."""

from app.outputs.output_format import Options, OutputFormat
from app.schemas import DetectResponse


def confidence(symmetry_error: float, max_error: float) -> float:
    """1 for an exact symmetry, 0 at the threshold, falling with the root of the error: a distance, as people see it."""
    return max(0.0, 1.0 - (symmetry_error / max_error) ** 0.5)


def write(response: DetectResponse, options: Options) -> bytes:
    """The planes in the order of the response, input coordinates."""
    lines = [str(len(response.planes))]
    for plane in response.planes:
        numbers = [*plane.normal, *plane.point, confidence(plane.symmetry_error, options.max_error)]
        lines.append(" ".join(map(repr, numbers)))
    return ("\n".join(lines) + "\n").encode()


FORMAT = OutputFormat(
    "shrec",
    "text/plain",
    "`format=shrec`: how many planes, then `nx ny nz px py pz confidence` a line.",
    write=write,
)
