"""The formats of answers: one line for each.

All lists of them (in the query, Accept, the API documentation, the command line, the viewer) comes from here.
"""

from app.outputs import bop, csv_rows, foundationpose, glb, obj, ply, shrec, stl, symmetries_json
from app.outputs.mesh_file import MeshWriter
from app.outputs.output_format import OutputFormat

OUTPUTS: tuple[OutputFormat, ...] = (
    symmetries_json.FORMAT,
    ply.FORMAT,
    glb.FORMAT,
    bop.FORMAT,
    foundationpose.FORMAT,
    csv_rows.FORMAT,
    shrec.FORMAT,
    obj.FORMAT,
    stl.FORMAT,
)
"""The first is sent to a client to whom several are as welcome."""

DETECT_OUTPUTS: dict[str, OutputFormat] = {output.name: output for output in OUTPUTS if output.tells_symmetries}
"""What ``POST /detect`` can answer with, by name."""

MESH_WRITERS: dict[str, MeshWriter] = {output.name: output.mesh for output in OUTPUTS if output.mesh is not None}
"""What ``POST /complete`` can answer with, by name."""
