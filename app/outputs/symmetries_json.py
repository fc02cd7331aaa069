"""JSON, as `app.schemas.DetectResponse` describes it."""

from collections.abc import Sequence

from app.outputs.output_format import Options, OutputFormat
from app.schemas import DetectResponse, to_json


def _write(response: DetectResponse, options: Options) -> bytes:
    return to_json(response, options.include)


def _write_all(responses: Sequence[tuple[str, DetectResponse]], options: Options) -> bytes:
    """A list."""
    return b"[" + b",\n".join(to_json(response, options.include) for _, response in responses) + b"]"


FORMAT = OutputFormat(
    "json",
    "application/json",
    "The symmetries with all their numbers.",
    write=_write,
    write_all=_write_all,
    schema={"$ref": "#/components/schemas/DetectResponse"},
)
