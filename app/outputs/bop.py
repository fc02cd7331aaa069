"""An entry of a BOP data set's ``models_info.json`` (https://bop.felk.cvut.cz): box and symmetries of one model."""

import json
from collections.abc import Sequence
from pathlib import PurePath

from app.outputs.output_format import Options, OutputFormat
from app.schemas import BopEntry, DetectResponse


def entry(response: DetectResponse) -> BopEntry:
    """The entry, lengths in input units (BOP's are millimetres), for a response that has ``bop``.

    Reflections do not exist in BOP, which knows proper rotations only. An empty list means as much as none there, and
    is left out.
    """
    assert response.bop is not None
    low, high = response.mesh.bounds
    sides = [end - start for start, end in zip(low, high, strict=True)]
    return BopEntry(
        diameter=response.bop.diameter,
        min_x=low[0],
        min_y=low[1],
        min_z=low[2],
        size_x=sides[0],
        size_y=sides[1],
        size_z=sides[2],
        symmetries_discrete=response.bop.symmetries_discrete or None,
        symmetries_continuous=response.bop.symmetries_continuous or None,
    )


def write(response: DetectResponse, options: Options | None = None) -> bytes:
    """The entry as UTF-8 JSON."""
    return entry(response).model_dump_json(exclude_none=True).encode()


def model_id(path: PurePath) -> str:
    """The name of a model in ``models_info.json``: the number of ``obj_000012.ply``, or a file's name as it is."""
    head, _, number = path.stem.partition("_")
    return str(int(number)) if head == "obj" and number.isascii() and number.isdigit() else path.stem


def write_all(responses: Sequence[tuple[str, DetectResponse]], options: Options) -> bytes:
    """A whole ``models_info.json``."""
    entries = {name: entry(response).model_dump(exclude_none=True) for name, response in responses}
    return json.dumps(entries, indent=2).encode()


FORMAT = OutputFormat(
    "bop",
    "application/vnd.prsnet.bop+json",
    "`format=bop`, then sent as application/json: an entry of `models_info.json`.",
    write=write,
    write_all=write_all,
    entry_name=model_id,
    include=("bop",),
    query_media_type="application/json",  # saved from a browser or piped into a tool, an entry is JSON
    schema={"$ref": "#/components/schemas/BopEntry"},
)
