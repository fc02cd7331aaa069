"""Pictures of PLY: named in a comment, laid by vertices or by the corners of faces."""

import struct
import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from app import halve
from app.client.companions import companions
from app.detection import MeshLimits
from app.editing import HalveOptions, edit_file
from model import Detector
from model.errors import DegenerateMeshError
from model.formats import read_mesh
from model.formats.conversion import as_mesh, files_at_hand
from model.meshes.mesh import Mesh

CORNERS = [(0, 0, 0), (4, 0, 0), (4, 2, 0), (0, 2, 0), (8, 0, 0), (8, 2, 0)]
FACES = [(0, 1, 2, 3), (1, 4, 5, 2)]  # side by side
RED, BLUE = b"\x89PNG\r\n\x1a\nred", b"\xff\xd8\xffblue"
FILES = {"red one.png": RED, "blue.jpg": BLUE}
BY_CORNER = [[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)], [(0.25, 0.5), (0.75, 0.5), (0.75, 1.0), (0.25, 1.0)]]


def ascii_by_vertex(names: tuple[str, str] = ("s", "t"), picture: str = "red one.png") -> bytes:
    rows = "\n".join(f"{x} {y} {z} {x / 8} {y / 2}" for x, y, z in CORNERS)
    faces = "\n".join(f"4 {' '.join(map(str, face))}" for face in FACES)
    return (
        f"ply\nformat ascii 1.0\ncomment TextureFile {picture}\nelement vertex 6\nproperty float x\nproperty float y\n"
        f"property float z\nproperty float {names[0]}\nproperty float {names[1]}\nelement face 2\n"
        f"property list uchar int vertex_indices\nend_header\n{rows}\n{faces}\n"
    ).encode()


def by_corner(
    order: str = "<", *, colors: bool = False, numbers: tuple[int, int] = (0, 1), short: bool = False
) -> bytes:
    """As MeshLab writes it, with a picture for each face; ``short``: the second face tells of one corner alone."""
    kind = "binary_little_endian" if order == "<" else "binary_big_endian"
    tints = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue")) if colors else ""
    header = (
        f"ply\nformat {kind} 1.0\ncomment TextureFile red one.png\ncomment TextureFile blue.jpg\nelement vertex 6\n"
        f"property float x\nproperty float y\nproperty float z\n{tints}element face 2\n"
        "property list uchar int vertex_indices\nproperty list uchar float texcoord\nproperty int texnumber\n"
        "end_header\n"
    ).encode()
    body = b"".join(struct.pack(order + "3f", *corner) + (b"\x09\x63\xc8" if colors else b"") for corner in CORNERS)
    for face, places, number in zip(FACES, BY_CORNER, numbers, strict=True):
        flat = [value for place in places for value in place][: 2 if short and number else None]
        body += struct.pack(f"{order}B4i", 4, *face) + struct.pack(f"{order}B{len(flat)}f", len(flat), *flat)
        body += struct.pack(order + "i", number)
    return header + body


def zipped(files: dict[str, bytes]) -> bytes:
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        for name, content in files.items():
            file.writestr(name, content)
    return stream.getvalue()


def read(data: bytes, name: str = "a.ply") -> Mesh:
    return read_mesh(data, name, resources=files_at_hand(FILES), looks=True)


@pytest.mark.parametrize("names", [("s", "t"), ("u", "v"), ("texture_u", "texture_v")])
def test_places_of_vertices(names: tuple[str, str]) -> None:
    mesh = read(ascii_by_vertex(names))
    assert mesh.texture is not None
    assert [picture.content for picture in mesh.texture.pictures] == [RED]
    assert (mesh.texture.of_face == 0).all()
    expected = np.stack([mesh.vertices[:, 0] / 8, 1.0 - mesh.vertices[:, 1] / 2], axis=1)  # from above
    assert np.allclose(mesh.texture.places, expected)


@pytest.mark.parametrize("order", ["<", ">"])
def test_places_of_corners(order: str) -> None:
    mesh = read(by_corner(order))
    assert mesh.texture is not None
    assert [picture.content for picture in mesh.texture.pictures] == [RED, BLUE]
    right = mesh.vertices[mesh.faces].mean(axis=1)[:, 0] > 4
    assert (mesh.texture.of_face == right).all()
    for face, number in zip(mesh.faces, mesh.texture.of_face, strict=True):
        for corner in face:
            at = FACES[number].index(CORNERS.index(tuple(mesh.vertices[corner])))
            place = BY_CORNER[number][at]
            assert np.allclose(mesh.texture.places[corner], [place[0], 1.0 - place[1]])
    assert mesh.area == pytest.approx(16.0)
    # The vertices where the pictures meet are two, at one place.
    assert len(mesh.vertices) == 8


def test_colours_do_not_darken_the_picture() -> None:
    assert read(by_corner(colors=True)).colors is None
    half = read(by_corner(colors=True, numbers=(0, 7)))  # there is no eighth picture
    assert half.texture is not None
    assert half.colors is not None
    for face, number in zip(half.faces, half.texture.of_face, strict=True):
        assert (half.colors[face, :3] == (255 if number == 0 else [9, 99, 200])).all()


def test_a_face_that_tells_of_too_few_corners_has_no_picture() -> None:
    mesh = read(by_corner(short=True))
    assert mesh.texture is not None
    assert sorted(mesh.texture.of_face) == [-1, -1, 0, 0]
    assert mesh.area == pytest.approx(16.0)


def test_without_the_pictures_it_is_the_shape() -> None:
    for data in (ascii_by_vertex(), by_corner()):
        mesh = read_mesh(data, "a.ply", looks=True)
        assert mesh.texture is None
        assert mesh.area == pytest.approx(16.0)
        plain = read_mesh(data, "a.ply")
        assert plain.painted
        assert len(plain.vertices) == 6
    no_picture = ascii_by_vertex().replace(b"comment TextureFile red one.png\n", b"")
    assert not read_mesh(no_picture, "a.ply").painted


def test_pictures_beside_it_are_found_sent_along_and_kept(tmp_path: Path) -> None:
    for name, content in FILES.items():
        (tmp_path / name).write_bytes(content)
    path = tmp_path / "a.ply"
    path.write_bytes(by_corner())
    assert sorted(item.name for item in companions(path, looks=True)) == sorted(FILES)
    assert companions(path) == []
    beside = as_mesh(path, looks=True)
    assert beside.texture is not None
    inside = read_mesh(
        zipped({"in/a.ply": by_corner(), **{f"in/{name}": data for name, data in FILES.items()}}), "a.zip", looks=True
    )
    assert inside.texture is not None
    assert np.array_equal(inside.texture.places, beside.texture.places)
    done, mesh = edit_file(
        Detector.load("default"), by_corner(), "a.ply", HalveOptions([1.0, 0.0, 0.0, -4.0]), MeshLimits(),
        resources=files_at_hand(FILES),
    )  # fmt: skip
    assert done.mesh.faces == 2
    assert mesh.texture is not None
    assert set(mesh.texture.of_face) == {1}
    half = halve(path, [1.0, 0.0, 0.0, -4.0])
    assert half.vertices[:, 0].min() == 4.0
    assert half.texture is not None
    assert set(half.texture.of_face) == {1}
    again = halve(half, [0.0, 1.0, 0.0, -0.5])  # and what is made of it keeps it too
    assert again.texture is not None
    assert set(again.texture.of_face) == {1}


def test_indices_out_of_range_are_left_for_others_to_find() -> None:
    data = by_corner().replace(struct.pack("<B4i", 4, 1, 4, 5, 2), struct.pack("<B4i", 4, 1, 4, 500, 2))
    with pytest.raises(DegenerateMeshError):
        read(data)
