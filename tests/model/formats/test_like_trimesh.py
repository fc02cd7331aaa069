"""Files that trimesh writes are read as trimesh reads them: the same numbers, in the same order."""

import io

import numpy as np
import pytest
import trimesh

from benchmarks.meshes import SHAPES
from model.formats import read_mesh

MOVE = trimesh.transformations.rotation_matrix(0.7, [1.0, 2.0, 3.0], [0.1, 0.2, 0.3])


@pytest.mark.parametrize("shape", sorted(SHAPES))
@pytest.mark.parametrize("kind", ["stl", "stl_ascii", "ply", "ply_ascii", "glb", "obj", "off"])
def test_surfaces_come_out_as_they_do_there(kind: str, shape: str):
    vertices, faces = SHAPES[shape](2_000)
    mesh = trimesh.Trimesh(10.0 * vertices + 1.0, faces, process=False)
    extension, _, encoding = kind.partition("_")
    options = {"encoding": "ascii"} if kind == "ply_ascii" else {}
    written = mesh.export(file_type="stl_ascii" if kind == "stl_ascii" else extension, **options)
    data = written.encode() if isinstance(written, str) else written
    ours = read_mesh(data, f"a.{extension}")
    theirs = trimesh.load_mesh(io.BytesIO(data), file_type=extension, process=False)
    mine, other = ours.vertices[ours.faces], np.asarray(theirs.triangles)
    if encoding == "ascii":  # trimesh keeps half of the digits there
        mine, other = mine.astype(np.float32), other.astype(np.float32)
    assert np.array_equal(mine, other)


def test_a_moved_part_of_a_scene_is_where_it_is_there():
    scene = trimesh.Scene()
    for shape in ("solid", "soup"):
        scene.add_geometry(trimesh.Trimesh(*SHAPES[shape](500), process=False), transform=MOVE, node_name=shape)
    data = scene.export(file_type="glb")
    ours = read_mesh(data, "a.glb")
    theirs = trimesh.load_scene(io.BytesIO(data), file_type="glb", process=False).to_mesh()
    mine, other = ours.vertices[ours.faces], np.asarray(theirs.triangles)
    assert mine.shape == other.shape
    np.testing.assert_allclose(np.sort(mine.reshape(-1, 3), axis=0), np.sort(other.reshape(-1, 3), axis=0), atol=1e-12)
