"""Materials and pictures: read where they are asked for, carried to what is made of a mesh, written as they came."""

import json
from base64 import b64encode
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from app import align, complete, editing, local
from app.outputs.mesh_file import BodyError, Counts, bounds_of
from app.outputs.registry import MESH_WRITERS
from model import Detector
from model.formats import read_mesh
from model.formats.conversion import as_mesh, files_at_hand
from model.meshes.mesh import Mesh
from model.meshes.texture import Picture, Texture
from tests.model.formats.test_gltf_as_shown import F32, U8, U16, Document

GLB = MESH_WRITERS["glb"]
COLORS = "considered"


def png(color: tuple[int, int, int]) -> bytes:
    stream = BytesIO()
    Image.new("RGB", (2, 2), color).save(stream, "PNG")
    return stream.getvalue()


def jpeg() -> bytes:
    stream = BytesIO()
    Image.new("RGB", (4, 4), (9, 90, 200)).save(stream, "JPEG")
    return stream.getvalue()


def places_at(points: np.ndarray) -> np.ndarray:
    """Where a point of the box below is in its picture: as smooth a map as there is."""
    return np.stack([0.3 * points[:, 0] + 0.1 * points[:, 2], 1.0 - 0.2 * points[:, 1]], axis=1)


def laid_box() -> Mesh:
    """A box with one picture above z = 0, another one below on its left, and none on its right."""
    box = trimesh.creation.box((4, 2, 2)).subdivide().subdivide()
    corners = np.array(box.triangles).reshape(-1, 3)
    centres = box.triangles_center
    of_face = np.where(centres[:, 2] > 0, 0, np.where(centres[:, 0] < 0, 1, -1)).astype(np.int32)
    texture = Texture(places_at(corners).astype(np.float32), of_face, (Picture(png((255, 0, 0)), "image/png"),
                                                                       Picture(jpeg(), "image/jpeg")))  # fmt: skip
    return Mesh.checked(corners, np.arange(len(corners)).reshape(-1, 3), texture=texture)


def require_laid(mesh: Mesh, tolerance: float = 2e-5) -> None:
    """Every face has the picture, and every corner the place, that belong where it is."""
    assert mesh.texture is not None
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    expected = np.where(centres[:, 2] > 0, 0, np.where(centres[:, 0] < 0, 1, -1))
    assert (mesh.texture.of_face == expected).all()
    drawn = np.unique(mesh.faces[mesh.texture.of_face >= 0])
    assert np.abs(mesh.texture.places[drawn] - places_at(mesh.vertices[drawn])).max() < tolerance
    assert [each.content for each in mesh.texture.pictures] == [png((255, 0, 0)), jpeg()]


def written(mesh: Mesh) -> bytes:
    return GLB.file(mesh.vertices, mesh.faces, mesh.colors, mesh.texture)


def test_pictures_survive_a_round_trip() -> None:
    data = written(laid_box())
    again = read_mesh(data, "a.glb", looks=True)
    require_laid(again)
    assert len(again.faces) == len(laid_box().faces)
    assert again.area == pytest.approx(laid_box().area)
    plain = read_mesh(data, "a.glb")
    assert plain.texture is None
    assert plain.painted


def test_other_programs_see_the_same_pictures(tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(written(laid_box()))
    scene = trimesh.load(tmp_path / "a.glb", process=False)
    seen = {}
    for part in scene.geometry.values():
        image = part.visual.material.baseColorTexture
        if image is None:
            continue
        seen[image.format] = len(part.faces)
        used = np.unique(part.faces)
        uv, points = part.visual.uv[used], part.vertices[used]
        assert np.abs(np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1) - places_at(points)).max() < 1e-5
    assert seen == {"PNG": 96, "JPEG": 48}


def test_half_and_completion_and_aligned_copy_keep_the_pictures() -> None:
    box = laid_box()
    half, *_ = editing.half_of(box, np.array([0.0, 1, 0, 0]))
    require_laid(half)
    assert half.area == pytest.approx(box.area / 2)
    # The other half is laid with the mirrored picture.
    done = complete(half, plane=[0, 1, 0, 0])
    result = Mesh.checked(done.vertices, done.faces, texture=done.texture)
    assert result.area == pytest.approx(box.area)
    assert result.texture is not None
    mirrored = result.vertices * [1, -1, 1]
    drawn = np.unique(result.faces[result.texture.of_face >= 0])
    nearest = np.minimum(
        np.abs(result.texture.places - places_at(result.vertices)).max(axis=1),
        np.abs(result.texture.places - places_at(mirrored)).max(axis=1),
    )
    assert nearest[drawn].max() < 2e-5
    turned = trimesh.transformations.rotation_matrix(0.3, (1, 2, 3))[:3, :3]
    moved = align(Mesh.checked(box.vertices @ turned.T, box.faces, texture=box.texture))
    require_laid(back(moved, turned))


def back(moved: local.AlignedGeometry, turned: np.ndarray) -> Mesh:
    """An aligned copy moved back to where the box was."""
    points = (moved.vertices - moved.matrix[:3, 3]) @ moved.matrix[:3, :3] @ turned
    return Mesh.checked(points, moved.faces, texture=moved.texture)


def test_the_server_refuses_bodies_whose_pictures_are_none() -> None:
    mesh = laid_box()
    bounds = bounds_of(mesh.vertices, mesh.faces)
    counts = Counts(len(mesh.vertices), len(mesh.faces), bounds)
    body = GLB.body(mesh.vertices, mesh.faces, bounds, None, mesh.texture)
    assert GLB.head(counts, body)
    at = body.index(png((255, 0, 0)))
    huge = body[:-36] + (10**9).to_bytes(4, "little") + body[-32:]
    for broken in (
        body[:at] + b"<svg " + body[at + 5 :],  # another kind of picture
        body[:-4] + b"PICS",
        body[:-12] + (3).to_bytes(4, "little") + body[-8:],  # more pictures than there are
        body[:-8] + (7).to_bytes(4, "little") + body[-4:],  # other numbers of faces
        huge,
        body[:-20],
        body + b"\0\0\0\0",
        body[: 12 * (len(mesh.vertices) + len(mesh.faces)) + 8 * len(mesh.vertices)]
        + np.full(2 * len(mesh.vertices), np.nan, "<f4").tobytes()
        + body[at:],
    ):
        with pytest.raises(BodyError):
            GLB.head(counts, broken)


def textured_document(**used: object) -> tuple[Document, dict[str, object]]:
    document = Document()
    places = document.add(np.array([[0, 0], [1, 0], [0, 1], [0.5, 0.5]], "<f4"), F32, "VEC2")
    small = document.add(np.array([[0, 0], [255, 0], [0, 255], [51, 102]], "<u1"), U8, "VEC2", normalized=True)
    content = png((1, 2, 3))
    document.data += b"\0" * (-len(document.data) % 4)
    document.views.append({"byteOffset": len(document.data), "byteLength": len(content)})
    document.data += content
    primitive = {"attributes": {"POSITION": 0, "TEXCOORD_0": places, "TEXCOORD_1": small}, "indices": 1, "material": 0}
    more = {
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **used}}}],
        "textures": [{"source": 0}],
        "images": [{"bufferView": len(document.views) - 1, "mimeType": "image/png"}],
    }
    return document, {"meshes": [{"primitives": [primitive]}], **more}


@pytest.mark.parametrize(
    ("used", "expected"),
    [
        ({}, [[0, 0], [1, 0], [0, 1]]),
        ({"texCoord": 1}, [[0, 0], [1, 0], [0, 1]]),
        ({"extensions": {"KHR_texture_transform": {"offset": [0.5, 0.25], "scale": [2, 3]}}},
         [[0.5, 0.25], [2.5, 0.25], [0.5, 3.25]]),
        ({"extensions": {"KHR_texture_transform": {"rotation": np.pi / 2}}}, [[0, 0], [0, -1], [1, 0]]),
    ],
)  # fmt: skip
def test_places_of_gltf(used: dict[str, object], expected: list[list[float]]) -> None:
    document, more = textured_document(**used)
    read = document.read({}, looks=True, **more)
    assert read.texture is not None
    assert np.allclose(read.texture.places[read.faces[0]], expected, atol=1e-6)
    assert read.texture.of_face.tolist() == [0]
    assert read.texture.pictures[0].content == png((1, 2, 3))


WEBP = b"RIFF\x04\x00\x00\x00WEBP"
KTX2 = b"\xabKTX 20\xbb\r\n\x1a\n and more"


@pytest.mark.parametrize(
    ("extension", "kind", "content"),
    [("EXT_texture_webp", "image/webp", WEBP), ("KHR_texture_basisu", "image/ktx2", KTX2)],
)
def test_pictures_of_extensions_are_carried_through(extension: str, kind: str, content: bytes) -> None:
    document, more = textured_document()
    uri = f"data:{kind};base64,{b64encode(content).decode()}"
    more |= {"images": [{"uri": uri}], "textures": [{"extensions": {extension: {"source": 0}}}]}
    read = document.read({}, looks=True, extensionsUsed=[extension], extensionsRequired=[extension], **more)
    assert read.texture is not None
    assert [(each.content, each.media_type) for each in read.texture.pictures] == [(content, kind)]
    data = written(read)
    again = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    assert again["extensionsRequired"] == again["extensionsUsed"] == [extension]
    assert again["textures"] == [{"extensions": {extension: {"source": 0}}}]
    assert again["images"][0]["mimeType"] == kind
    back = read_mesh(data, "a.glb", looks=True)
    assert back.texture is not None
    assert back.texture.pictures == read.texture.pictures
    assert not back.warnings
    # Where there is a picture for everybody it is taken.
    more["images"].append({"uri": f"data:image/png;base64,{b64encode(png((1, 1, 1))).decode()}"})
    more["textures"][0]["source"] = 1
    for_all = document.read({}, looks=True, extensionsUsed=[extension], **more)
    assert for_all.texture is not None
    assert for_all.texture.pictures[0].media_type == "image/png"


def test_pictures_that_are_lost_are_told(tmp_path: Path) -> None:
    document, more = textured_document()
    lost = document.read({}, looks=True, **more | {"images": [{"uri": "elsewhere.png"}]})
    assert any("A picture of the surface left out" in text for text in lost.warnings)
    assert not any("left out" in text for text in document.read({}, looks=False, **more).warnings)
    (tmp_path / "a.mtl").write_text(MTL.format(picture="wood.tga"))
    (tmp_path / "wood.tga").write_bytes(b"no picture that is known")
    (tmp_path / "a.obj").write_text(OBJ.format(library="a.mtl"))
    assert any("A picture of the surface left out" in text for text in as_mesh(tmp_path / "a.obj", looks=True).warnings)


def test_broken_looks_of_gltf_cost_the_picture_and_not_the_shape() -> None:
    for broken in (
        {"images": [{"uri": "elsewhere.png"}]},
        {"images": [{"uri": "data:image/png;base64,AAAA"}]},
        {"images": []},
        {"textures": [{}]},
        {"textures": [{"source": -5}]},
        {"materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": "x"}}}]},
        {"materials": 3},
    ):
        document, more = textured_document()
        read = document.read({}, looks=True, **more | broken)
        assert read.texture is None
        assert len(read.faces) == 1


OBJ = """mtllib {library}
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 2 0 0
v 2 1 0
v 3 0 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl wood
f 1/1 2/2 3/3 4/4
usemtl paint
f 2//1 5 6 3
usemtl wood
f -3/-4/1 7/2 6/3
"""
MTL = "newmtl wood\nKd 0 0 0\nmap_Kd {picture}\nnewmtl paint\nKd 1 0.5 0\nd 0.5\n"


@pytest.mark.parametrize(("library", "picture"), [("a.mtl", "wood.png"), ("my stuff.mtl", "in/folder/my wood.png")])
def test_materials_of_obj(tmp_path: Path, library: str, picture: str) -> None:
    (tmp_path / "a.obj").write_text(OBJ.format(library=library))
    (tmp_path / library).write_text(MTL.format(picture=picture))
    (tmp_path / picture).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / picture).write_bytes(png((7, 8, 9)))
    mesh = as_mesh(tmp_path / "a.obj", looks=True)
    assert mesh.texture is not None
    assert mesh.colors is not None
    assert mesh.texture.of_face.tolist() == [0, 0, -1, -1, 0]
    for face, tint in zip(mesh.faces, mesh.texture.of_face, strict=True):
        colors = mesh.colors[face].tolist()
        assert colors == [[255, 255, 255, 255] if tint == 0 else [255, 128, 0, 128]] * 3
    quad = mesh.faces[:2].reshape(-1)  # OBJ counts from below
    assert np.allclose(mesh.texture.places[quad], mesh.vertices[quad][:, :2] * [1, -1] + [0, 1])
    assert np.allclose(mesh.texture.places[mesh.faces[4]], [[0, 1], [1, 1], [1, 0]])
    plain = as_mesh(tmp_path / "a.obj")
    assert np.array_equal(mesh.vertices[mesh.faces], plain.vertices[plain.faces])
    assert len(plain.vertices) == 7
    assert plain.painted
    sent = files_at_hand({library: MTL.format(picture=picture).encode(), picture: png((7, 8, 9))})
    uploaded = read_mesh((tmp_path / "a.obj").read_bytes(), "a.obj", resources=sent, looks=True)
    assert uploaded.texture is not None
    assert np.array_equal(uploaded.texture.places, mesh.texture.places)


def test_obj_without_its_library_is_the_shape() -> None:
    mesh = read_mesh(OBJ.format(library="a.mtl").encode(), "a.obj", looks=True)
    assert mesh.texture is None
    assert mesh.colors is None
    assert len(mesh.vertices) == 7


def test_a_broken_library_is_no_error() -> None:
    for library in (
        b"\xff\xfe\0\0",
        b"newmtl wood\nKd\nmap_Kd\nd\n",
        b"newmtl wood\nKd nan inf -3\nd x\n",
        b"Kd 1 1 1",
    ):
        text = OBJ.format(library="a.mtl") + "f 1/999 2/0 3/-99\n"
        mesh = read_mesh(text.encode(), "a.obj", resources=files_at_hand({"a.mtl": library}), looks=True)
        assert len(mesh.faces) == 6


def test_colours_that_were_not_considered_are_told() -> None:
    detector = Detector.load()
    box = laid_box()
    said = detector.detect(box).warnings
    assert any(COLORS in text for text in said)
    assert not any(COLORS in text for text in detector.detect(Mesh.checked(box.vertices, box.faces)).warnings)
    one = np.full((len(box.vertices), 4), 9, dtype=np.uint8)  # the same everywhere breaks nothing
    assert not any(
        COLORS in text for text in detector.detect(Mesh.checked(box.vertices, box.faces, colors=one)).warnings
    )


def test_a_written_file_follows_the_format() -> None:
    data = written(laid_box())
    length = int.from_bytes(data[12:16], "little")
    document = json.loads(data[20 : 20 + length])
    size = document["buffers"][0]["byteLength"]
    assert len(data) == 20 + length + 8 + size
    for view in document["bufferViews"]:
        assert view["byteOffset"] % 4 == 0
        assert view["byteOffset"] + view["byteLength"] <= size
    widths = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
    for each in document["accessors"]:
        bytes_each = {U16: 2, 5125: 4, F32: 4}[each["componentType"]] * widths[each["type"]]
        room = document["bufferViews"][each["bufferView"]]["byteLength"] - each.get("byteOffset", 0)
        assert each["count"] * bytes_each <= room
    primitives = document["meshes"][0]["primitives"]
    assert sum(document["accessors"][each["indices"]]["count"] for each in primitives) == 3 * len(laid_box().faces)
