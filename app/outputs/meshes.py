"""The mesh formats by name."""

from app.outputs import glb, obj, ply, stl
from app.outputs.mesh_file import MeshWriter
from app.schemas import MeshFormat

WRITERS: dict[MeshFormat, MeshWriter] = {
    "ply": ply.WRITER,
    "glb": glb.WRITER,
    "obj": obj.WRITER,
    "stl": stl.WRITER,
}
