"""Which format a request wants: ``format=`` in its query, or else the header Accept (RFC 9110, section 12.5.1)."""

from dataclasses import dataclass

from app.outputs.output_format import OutputFormat
from app.outputs.registry import DETECT_OUTPUTS

MEDIA_TYPES: dict[str, OutputFormat] = {output.media_type: output for output in DETECT_OUTPUTS.values()}
"""By Accept, the first being what is sent where several are as welcome."""


@dataclass(frozen=True, slots=True)
class Choice:
    """What to answer with, and what to call it."""

    output: OutputFormat
    media_type: str


def choose(wanted: str | None, accept: str | None) -> Choice | None:
    """The format to answer in, or None when the client accepts none there is. ``format=`` outweighs Accept."""
    if wanted is not None:
        output = DETECT_OUTPUTS[wanted]
        return Choice(output, output.query_media_type or output.media_type)
    if accept is None or not accept.strip():
        accept = "*/*"
    ranges = _ranges(accept)
    weights = {name: _weight(name, ranges) for name in MEDIA_TYPES}
    best = max(weights, key=lambda name: weights[name])  # the first of equals
    return Choice(MEDIA_TYPES[best], best) if weights[best] > 0 else None


def _ranges(accept: str) -> list[tuple[str, float]]:
    """Media ranges and their weights; what cannot be read as a weight is 0."""
    found: list[tuple[str, float]] = []
    for item in accept.lower().split(","):
        name, *parameters = (part.strip() for part in item.split(";"))
        weight = 1.0
        for parameter in parameters:
            key, _, value = parameter.partition("=")
            if key.strip() == "q":
                try:
                    weight = float(value)
                except ValueError:
                    weight = 0.0
        found.append((name, weight if 0.0 <= weight <= 1.0 else 0.0))
    return found


def _weight(name: str, ranges: list[tuple[str, float]]) -> float:
    """The weight of the most specific range that ``name`` is in."""
    for candidate in (name, name.split("/")[0] + "/*", "*/*"):
        weights = [weight for range_, weight in ranges if range_ == candidate]
        if weights:
            return max(weights)
    return 0.0
