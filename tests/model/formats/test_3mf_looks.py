"""Colours and pictures of 3MF: every kind of group, mixed and in layers, on triangles and corners."""

import numpy as np
import pytest

from app import halve
from model.errors import MeshTooLargeError
from model.formats import read_mesh
from model.formats.conversion import as_mesh
from tests.model.mesh_files import archive
from tests.model.meshes.test_looks import jpeg, png

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
MATERIAL = "http://schemas.microsoft.com/3dmanufacturing/material/2015/02"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
CORNERS = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)))
OPEN = f'<model xmlns="{CORE}" xmlns:m="{MATERIAL}" xmlns:p="{PRODUCTION}"><resources>'
TEXTURES = (
    '<m:texture2d id="1" path="/3D/Textures/wood.png" contenttype="image/png"/>'
    '<m:texture2d id="2" path="/3D/Textures/sky.jpg" contenttype="image/jpeg"/>'
    '<m:texture2dgroup id="3" texid="1"><m:tex2coord u="0" v="0"/><m:tex2coord u="1" v="0"/>'
    '<m:tex2coord u="0" v="1"/></m:texture2dgroup>'
    '<m:texture2dgroup id="4" texid="2"><m:tex2coord u="0.25" v="0.75"/></m:texture2dgroup>'
    '<basematerials id="5"><base name="a" displaycolor="#FF0000"/><base name="b" displaycolor="#0000FF"/>'
    '</basematerials><m:colorgroup id="6"><m:color color="#00FF0080"/><m:color color="#808080"/></m:colorgroup>'
    '<m:compositematerials id="7" matid="5" matindices="0 1"><m:composite values="0.2 0.8"/></m:compositematerials>'
    '<m:multiproperties id="8" pids="5 3"><m:multi pindices="0 2"/></m:multiproperties>'
    '<m:multiproperties id="9" pids="3 6" blendmethods="multiply"><m:multi pindices="1 1"/></m:multiproperties>'
    '<m:multiproperties id="10" pids="5 6" blendmethods="mix"><m:multi pindices="0 0"/></m:multiproperties>'
)
TRIANGLES = ("0 2 1", "0 1 3", "1 2 3", "2 0 3")


def model(looks, of_object=""):
    """A tetrahedron whose triangles have the attributes that are given."""
    triangles = ""
    for corners, look in zip(TRIANGLES, looks, strict=True):
        a, b, c = corners.split()
        triangles += f'<triangle v1="{a}" v2="{b}" v3="{c}" {look}/>'
    mesh = f"<mesh><vertices>{CORNERS}</vertices><triangles>{triangles}</triangles></mesh>"
    return f'{OPEN}{TEXTURES}<object id="20" {of_object}>{mesh}</object></resources>'


def packed(text, **more):
    pictures = {"3D/Textures/wood.png": png((90, 60, 30)), "3D/Textures/sky.jpg": jpeg()}
    return archive(text, **{**pictures, **more})


PLACED = '<build><item objectid="20"/></build></model>'


def looks_of(mesh):
    """Of every triangle its picture, and the colours and places of its corners."""
    colors = np.full((len(mesh.vertices), 4), 255) if mesh.colors is None else mesh.colors
    return mesh.texture.of_face.tolist(), colors[mesh.faces].tolist(), mesh.texture.places[mesh.faces].tolist()


def test_pictures_of_3mf():
    looks = ('pid="3" p1="0" p2="1" p3="2"', 'pid="4" p1="0"', 'pid="5" p1="1"', "")
    mesh = read_mesh(packed(model(looks) + PLACED), "a.3mf", looks=True)
    assert mesh.warnings == ()
    assert [each.media_type for each in mesh.texture.pictures] == ["image/png", "image/jpeg"]
    pictures, colors, places = looks_of(mesh)
    assert pictures == [0, 1, -1, -1]
    assert places[0] == [[0, 1], [1, 1], [0, 0]]  # 3MF counts from below
    assert places[1] == [[0.25, 0.25]] * 3
    assert colors == [[[255] * 4] * 3, [[255] * 4] * 3, [[0, 0, 255, 255]] * 3, [[255] * 4] * 3]
    plain = read_mesh(packed(model(looks) + PLACED), "a.3mf")
    assert plain.painted
    assert plain.texture is None
    assert np.array_equal(plain.vertices[plain.faces], mesh.vertices[mesh.faces])


def test_mixed_materials_and_layers_of_3mf():
    looks = ('pid="7" p1="0"', 'pid="8" p1="0"', 'pid="9" p1="0"', 'pid="10" p1="0"')
    pictures, colors, places = looks_of(read_mesh(packed(model(looks) + PLACED), "a.3mf", looks=True))
    assert pictures == [-1, 0, 0, -1]
    assert colors[0] == [[51, 0, 204, 255]] * 3
    assert (colors[1], places[1]) == ([[255] * 4] * 3, [[0, 0]] * 3)  # the upper one of two layers
    assert (colors[2], places[2]) == ([[128, 128, 128, 255]] * 3, [[1, 1]] * 3)  # times the grey of the other one
    assert colors[3] == [[127, 128, 0, 255]] * 3  # half of the lower layer shows


def test_pictures_of_3mf_in_several_parts_and_mirrored():
    part = model(('pid="3" p1="0" p2="1" p3="2"',) * 4, 'p:UUID="1"') + "<build/></model>"
    main = (
        f'{OPEN}{TEXTURES}<object id="21"><components><component objectid="20" p:path="/3D/Objects/one.model" '
        'transform="-1 0 0 0 1 0 0 0 1 0 0 0"/></components></object></resources><build><item objectid="21"/></build>'
        "</model>"
    )
    mesh = read_mesh(packed(main, **{"3D/Objects/one.model": part}), "a.3mf", looks=True)
    assert len(mesh.texture.pictures) == 2
    assert mesh.texture.of_face.tolist() == [0] * 4
    corners = mesh.vertices[mesh.faces[0]]
    at = {tuple(place): tuple(point) for place, point in zip(looks_of(mesh)[2][0], corners, strict=True)}
    assert at == {(0, 1): (0, 0, 0), (1, 1): (0, 1, 0), (0, 0): (-1, 0, 0)}


def test_half_of_3mf_keeps_its_picture(tmp_path):
    places = ['pid="3" p1="0" p2="1" p3="2"'] * 4
    (tmp_path / "a.3mf").write_bytes(packed(model(places) + PLACED))
    half = halve(tmp_path / "a.3mf", plane=[1, 0, 0, -0.2])
    assert half.texture is not None
    assert half.texture.pictures[0].content == png((90, 60, 30))
    half.save(tmp_path / "half.glb")
    again = as_mesh(tmp_path / "half.glb", looks=True)
    assert again.texture.pictures[0].content == png((90, 60, 30))


@pytest.mark.parametrize("text", ['u="x" v="0"', 'v="0"', 'u="nan" v="inf"', 'u="1e300" v="0"'])
def test_broken_places_of_3mf_cost_the_picture_and_not_the_shape(text):
    broken = model(('pid="4" p1="0"',) * 4).replace('u="0.25" v="0.75"', text) + PLACED
    mesh = read_mesh(packed(broken), "a.3mf", looks=True)
    assert len(mesh.faces) == 4
    assert mesh.texture is None


def test_pictures_of_3mf_that_are_lost_are_told():
    text = model(('pid="3" p1="0"',) * 4) + PLACED
    for content in (b"BM and so on", None):
        pictures = {} if content is None else {"3D/Textures/wood.png": content, "3D/Textures/sky.jpg": jpeg()}
        mesh = read_mesh(archive(text, **pictures), "a.3mf", looks=True)
        assert mesh.texture is None
        assert any("of the surface left out" in warning for warning in mesh.warnings)
        assert len(mesh.faces) == 4


def test_pictures_of_3mf_count_as_unpacked():
    text = model(('pid="3" p1="0"',) * 4) + PLACED
    data = packed(text, **{"3D/Textures/wood.png": png((1, 2, 3)) + b"\0" * 1_000_000})
    with pytest.raises(MeshTooLargeError, match="unpacks to more"):
        read_mesh(data, "a.3mf", looks=True, max_unpacked_bytes=500_000)


def test_as_many_colours_of_3mf_as_vertices_are_no_crowd_of_objects():
    colors = '<m:color color="#102030"/>' * 300
    text = model(('pid="30" p1="299"',) * 4).replace("<basematerials", f'<m:colorgroup id="30">{colors}</m:colorgroup>'
                                                      "<basematerials", 1) + PLACED  # fmt: skip
    mesh = read_mesh(packed(text), "a.3mf", looks=True, max_nodes=10)
    assert mesh.colors[mesh.faces].reshape(-1, 4).tolist() == [[16, 32, 48, 255]] * 12
    with pytest.raises(MeshTooLargeError, match="vertices"):
        read_mesh(packed(text), "a.3mf", looks=True, max_vertices=200)


def test_colours_of_3mf():
    material = "http://schemas.microsoft.com/3dmanufacturing/material/2015/02"
    corners = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)))
    triangles = (
        '<triangle v1="0" v2="2" v3="1"/><triangle v1="0" v2="1" v3="3" pid="2" p1="0" p2="1" p3="2"/>'
        '<triangle v1="1" v2="2" v3="3" p1="0"/><triangle v1="2" v2="0" v3="3" pid="9" p1="0"/>'
    )
    model = (
        f'<model xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" xmlns:m="{material}"><resources>'
        '<basematerials id="1"><base name="a" displaycolor="#FF0000"/><base name="b" displaycolor="#00FF0080"/>'
        '</basematerials><m:colorgroup id="2"><m:color color="#0000FF"/><m:color color="#00FFFF"/>'
        '<m:color color="#FFFF00"/></m:colorgroup>'
        f'<object id="5" pid="1" pindex="1"><mesh><vertices>{corners}</vertices><triangles>{triangles}</triangles>'
        '</mesh></object></resources><build><item objectid="5"/></build></model>'
    )
    data = archive(model)
    mesh = read_mesh(data, "a.3mf", looks=True)
    assert mesh.colors is not None
    seen = [mesh.colors[face].tolist() for face in mesh.faces]
    green, red = [0, 255, 0, 128], [255, 0, 0, 255]
    assert seen == [[green] * 3, [[0, 0, 255, 255], [0, 255, 255, 255], [255, 255, 0, 255]], [red] * 3,
                    [[255] * 4] * 3]  # fmt: skip
    plain = read_mesh(data, "a.3mf")
    assert len(plain.vertices) == 4
    assert plain.painted
    assert np.array_equal(plain.vertices[plain.faces], mesh.vertices[mesh.faces])
