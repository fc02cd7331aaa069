"""Which format a request wants: ``format=`` in its query, or else the header Accept (RFC 9110, section 12.5.1)."""

from dataclasses import dataclass

from app.schemas import Format

MEDIA_TYPES: dict[str, Format] = {
    "application/json": "json",
    "model/gltf-binary": "glb",
    "application/vnd.prsnet.bop+json": "bop",
    "text/csv": "csv",
    "text/plain": "shrec",
}
"""By Accept, the first being what is sent where several are as welcome."""


@dataclass(frozen=True, slots=True)
class Choice:
    """What to answer with, and what to call it."""

    format: Format
    media_type: str


def choose(wanted: Format | None, accept: str | None) -> Choice | None:
    """The format to answer in, or None when the client accepts none there is. ``format=`` is heard first."""
    if wanted is not None:
        # Saved from a browser or piped into a tool, a BOP entry is JSON.
        media_type = next(name for name, format in MEDIA_TYPES.items() if format == wanted)
        return Choice(wanted, "application/json" if wanted == "bop" else media_type)
    if accept is None or not accept.strip():
        return Choice("json", "application/json")
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
