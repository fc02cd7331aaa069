"""Zip archives with one mesh: read like the mesh, within limits; others refused with the way out."""

import zipfile
from io import BytesIO

import numpy as np
import pytest

from model.errors import MeshTooLargeError, UnreadableMeshError, UnsupportedFormatError
from model.formats import FORMATS, read_mesh
from tests.model.mesh_files import export, sample
from tests.model.meshes.test_looks import MTL, OBJ, png

STL = export(sample(), "stl")


def zipped(compression: int = zipfile.ZIP_DEFLATED, **files: bytes) -> bytes:
    """An archive; ``__`` in a name stands for a dot, ``___`` for a slash."""
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w", compression) as archive:
        for name, content in files.items():
            archive.writestr(name.replace("___", "/").replace("__", "."), content)
    return stream.getvalue()


@pytest.mark.parametrize("kind", ["stl", "obj", "ply", "off", "glb", "gltf", "3mf"])
def test_the_one_mesh_is_read(kind: str) -> None:
    data = export(sample(), kind)
    found = read_mesh(
        zipped(**{f"model___a__{kind}": data, "README__txt": b"hello", "model___.DS_Store": b"x"}), "a.zip"
    )
    plain = read_mesh(data, f"a.{kind}")
    assert np.array_equal(found.vertices, plain.vertices)
    assert np.array_equal(found.faces, plain.faces)
    assert found.source_format == kind
    assert FORMATS[kind]


@pytest.mark.parametrize("folder", ["", "source___"])
def test_what_the_mesh_keeps_beside_it_is_found(folder: str) -> None:
    data = zipped(
        **{
            f"{folder}a__obj": OBJ.format(library="a.mtl").encode(),
            f"{folder}a__mtl": MTL.format(picture="textures/wood.png").encode(),
            "textures___wood__png": png((4, 5, 6)),
        }
    )
    found = read_mesh(data, "a.ZIP", looks=True)
    assert found.texture is not None
    assert found.texture.pictures[0].content == png((4, 5, 6))


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({"a__stl": STL, "b__obj": b"x"}, "2 meshes; send one of them"),
        ({"a__txt": b"x"}, "no mesh"),
        ({"a__zip": zipped(a__stl=STL)}, "no mesh"),  # not opened
        ({}, "no mesh"),
    ],
)
def test_other_archives_are_refused(files: dict[str, bytes], words: str) -> None:
    with pytest.raises(UnsupportedFormatError, match=words):
        read_mesh(zipped(**files), "a.zip")


def test_bombs_are_not_unpacked() -> None:
    bomb = zipped(a__stl=b"\0" * (20 << 20))
    assert len(bomb) < 50_000
    with pytest.raises(MeshTooLargeError, match="unpacks to more than 1000000 bytes"):
        read_mesh(bomb, "a.zip", max_unpacked_bytes=1_000_000)
    # Headers may say less than there is.
    lying = bytearray(bomb)
    for at in (22, bytes(bomb).index(b"PK\x01\x02") + 24):
        lying[at : at + 4] = (100).to_bytes(4, "little")
    with pytest.raises((MeshTooLargeError, UnreadableMeshError)):
        read_mesh(bytes(lying), "a.zip", max_unpacked_bytes=1_000_000)
    beside = zipped(a__obj=OBJ.format(library="a.mtl").encode(), a__mtl=b"#" * (20 << 20))
    assert len(read_mesh(beside, "a.zip", max_unpacked_bytes=1_000_000).faces) == 5
    with pytest.raises(MeshTooLargeError):
        read_mesh(beside, "a.zip", max_unpacked_bytes=1_000_000, looks=True)


def test_damaged_archives() -> None:
    good = zipped(a__stl=STL)
    encrypted = bytearray(good)
    encrypted[6] |= 1
    encrypted[good.index(b"PK\x01\x02") + 8] |= 1
    flipped = bytearray(good)
    flipped[60] ^= 255
    for data in (
        good[:-30],
        good[:40],
        b"PK\x03\x04",
        bytes(encrypted),
        bytes(flipped),
        zipped(zipfile.ZIP_LZMA, a__stl=STL),
    ):
        with pytest.raises(UnreadableMeshError, match=r"zip archive|read as STL"):
            read_mesh(data, "a.zip")
    with pytest.raises(UnsupportedFormatError, match="web page"):
        read_mesh(b"<!doctype html><title>404</title>", "a.zip")
