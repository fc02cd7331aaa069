"""Files that need more than a reader of triangles, through a real server: libraries work inside the sandbox too."""

import json
from pathlib import Path

import httpx
import numpy as np
import pytest

from app import Client, UnusableMeshError
from model.formats import read_mesh
from tests.model.formats.test_archives import zipped
from tests.model.formats.test_gltf_as_shown import draco_gltf, separate
from tests.model.formats.test_point_clouds import FILES
from tests.model.meshes.test_looks import MTL, OBJ, png

from .server import Server

STAR = [(np.cos(t) * r, np.sin(t) * r) for t, r in zip(np.pi * np.arange(10) / 5, [10, 4] * 5, strict=True)]


def star_obj() -> bytes:
    """A prism over a star, with its two ends as concave polygons."""
    lines = [f"v {x!r} {y!r} {z}" for z in (0, 3) for x, y in np.array(STAR).tolist()]
    lines += ["f " + " ".join(str(i + 1) for i in range(9, -1, -1)), "f " + " ".join(str(i + 11) for i in range(10))]
    lines += [f"f {i + 1} {(i + 1) % 10 + 1} {(i + 1) % 10 + 11} {i + 11}" for i in range(10)]
    return "\n".join(lines).encode()


def test_concave_polygons_draco_and_meshopt_are_read_by_the_workers(server: Server, data: Path) -> None:
    star = server.detect("star.obj", star_obj())
    assert star.json()["point_group"] == "D5h", star.text
    assert all(plane["exact"] for plane in star.json()["planes"])
    mesh, draco = draco_gltf()
    assert server.detect("a.gltf", draco).json()["mesh"]["faces"] == len(mesh.faces)
    for name in ("torus_meshopt.glb", "torus_meshopt_exponential.glb"):
        answer = server.detect(name, (data / name).read_bytes())
        assert answer.json()["mesh"]["faces"] == 576, answer.text


def test_clouds_of_every_format_are_read_by_the_workers(server: Server) -> None:
    for name in ("headed", "pcd compressed", "npy", "npz packed", "las 1.4", "ply binary"):
        extension, data = FILES[name]
        answer = server.detect(f"scan.{extension}", data)
        assert answer.status_code == 200, answer.text
        assert answer.json()["mesh"]["kind"] == "points"
        # A dome over a square, seen from one side.
        assert len(answer.json()["planes"]) >= 2, answer.text
        assert not any(plane["exact"] for plane in answer.json()["planes"])
    assert server.detect("star.obj", star_obj()).json()["mesh"]["kind"] == "mesh"


def test_warnings_reach_the_answer(server: Server) -> None:
    text = star_obj() + b"\nv 0 0 9\n" + b"f 1 2 999\n"
    (warning,) = server.detect("star.obj", text).json()["warnings"]
    assert warning.startswith("1 face was left out")


def test_a_gltf_file_and_its_buffer_go_in_one_upload(server: Server, tmp_path: Path) -> None:
    mesh, text, files = separate("data/")
    form = [("file", ("a.gltf", text)), *(("file", (name, content)) for name, content in files.items())]
    whole = httpx.post(f"{server.url}/detect", files=form, timeout=60)
    assert whole.status_code == 200, whole.text
    assert whole.json()["mesh"]["filename"] == "a.gltf"
    assert whole.json()["mesh"]["faces"] == len(mesh.faces)
    alone = server.detect("a.gltf", text)
    assert (alone.status_code, alone.json()["type"]) == (422, "/problems/unreadable-mesh")
    assert "-F file=@chair.gltf -F file=@chair.bin" in alone.json()["detail"]
    completed = httpx.post(f"{server.url}/complete?normal=1,0,0", files=form, timeout=60)
    assert completed.status_code == 200, completed.text

    (tmp_path / "data").mkdir()
    (tmp_path / "a.gltf").write_bytes(text)
    with Client(server.url) as client:
        with pytest.raises(UnusableMeshError):
            client.detect(tmp_path / "a.gltf")
        for name, content in files.items():
            (tmp_path / "data" / name).write_bytes(content)
        assert client.detect(tmp_path / "a.gltf").mesh.faces == len(mesh.faces)
        assert client.detect({"a.gltf": text, **files}).mesh.faces == len(mesh.faces)


def test_a_file_outside_the_folder_is_not_sent(server: Server, tmp_path: Path) -> None:
    _, text, files = separate("../")
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a.gltf").write_bytes(text)
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    with Client(server.url) as client, pytest.raises(UnusableMeshError):
        client.detect(tmp_path / "in" / "a.gltf")
    assert json.loads(text)["buffers"][0]["uri"].startswith("../")


def test_materials_and_pictures_go_in_one_upload_and_come_back(server: Server, tmp_path: Path) -> None:
    """By hand, through the client, and in a zip archive: the same half, with its picture."""
    folder = tmp_path / "textures"
    folder.mkdir()
    (folder / "wood.png").write_bytes(png((4, 5, 6)))
    (tmp_path / "a.mtl").write_text(MTL.format(picture="textures/wood.png"))
    (tmp_path / "a.obj").write_text(OBJ.format(library="a.mtl"))
    query: dict[str, str] = {"format": "glb", "normal": "1,0,0", "offset": "-0.5"}
    contents = {path.name: path.read_bytes() for path in (tmp_path / "a.obj", tmp_path / "a.mtl", folder / "wood.png")}
    parts = [("file", (name, content)) for name, content in contents.items()]
    by_hand = httpx.post(f"{server.url}/halve", files=parts, params=query, timeout=60)
    assert by_hand.status_code == 200
    with Client(server.url) as client:
        through = client.halve(tmp_path / "a.obj", format="glb", plane=[1, 0, 0, -0.5])
    packed = zipped(**{name.replace(".", "__"): content for name, content in contents.items()})
    out_of_zip = httpx.post(f"{server.url}/halve", files={"file": ("a.zip", packed)}, params=query, timeout=60)
    assert out_of_zip.content == by_hand.content == through.data
    half = read_mesh(by_hand.content, "a.glb", looks=True)
    assert half.texture is not None
    assert half.texture.pictures[0].content == png((4, 5, 6))
    assert half.bounds[0][0] == pytest.approx(0.5)
    annotated = server.detect("a.zip", packed, format="glb")
    shown = read_mesh(annotated.content, "a.glb", looks=True)
    assert shown.texture is not None
    answer = server.detect("a.zip", packed).json()
    assert (answer["mesh"]["filename"], answer["mesh"]["format"]) == ("a.zip", "obj")


def test_a_zip_bomb_is_refused_with_a_sentence(server: Server) -> None:
    bomb = zipped(a__stl=b"\0" * (1200 << 20))
    assert len(bomb) < 2 << 20
    answer = server.detect("a.zip", bomb)
    assert answer.status_code == 413
    assert "unpacks to more than" in answer.json()["detail"]
    several = server.detect("a.zip", zipped(a__stl=b"x", b__stl=b"x"))
    assert several.status_code == 415
    assert "send one of them" in several.json()["detail"]
