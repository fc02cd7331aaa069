"""An entry of a BOP data set's ``models_info.json`` (https://bop.felk.cvut.cz): box and symmetries of one model."""

from app.schemas import BopEntry, DetectResponse


def entry(response: DetectResponse) -> BopEntry:
    """The entry, lengths in input units (BOP's are millimetres), for a response that has ``bop``.

    BOP's ``diameter`` is not among them: its own toolkit measures it. Reflections have no place in BOP, which knows
    proper rotations only. An empty list means as much as none there, and is left out.
    """
    low, high = response.mesh.bounds
    sides = [end - start for start, end in zip(low, high, strict=True)]
    return BopEntry(
        min_x=low[0],
        min_y=low[1],
        min_z=low[2],
        size_x=sides[0],
        size_y=sides[1],
        size_z=sides[2],
        symmetries_discrete=(response.bop.symmetries_discrete or None) if response.bop else None,
        symmetries_continuous=(response.bop.symmetries_continuous or None) if response.bop else None,
    )


def write(response: DetectResponse) -> bytes:
    """The entry as UTF-8 JSON."""
    return entry(response).model_dump_json(exclude_none=True).encode()
