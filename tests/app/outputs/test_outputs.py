"""The formats of an answer: read back by other programs, they say what the answer says."""

import csv
import io
import itertools
import json
from typing import Any

import numpy as np
import pytest
import trimesh

from app.detection import MeshLimits, Options, detect_file
from app.outputs import bop, csv_rows, glb, shrec
from app.outputs.mesh_file import BodyError, Counts, bounds_of
from app.outputs.negotiation import MEDIA_TYPES, choose
from app.outputs.output_format import Options as OutputOptions
from app.outputs.registry import MESH_WRITERS
from app.schemas import DetectResponse
from model import Detector
from model.errors import DegenerateMeshError
from model.formats.conversion import as_mesh
from model.meshes.mesh import Mesh
from tests.app.fakes import DATA

FORMATS = list(MESH_WRITERS)


@pytest.fixture(scope="module")
def answers() -> dict[str, tuple[DetectResponse, Mesh]]:
    detector, options = Detector.load(), Options(include=("bop",))
    names = ("chair.obj", "vase.ply", "donut.gltf", "plant.off", "table.glb")
    return {
        name: detect_file(detector, (DATA / name).read_bytes(), name, options, MeshLimits()) for name in names
    }  # fmt: skip


def reread(data: bytes, kind: str) -> trimesh.Trimesh:
    return trimesh.load(io.BytesIO(data), file_type=kind, process=False, force="mesh")


def annotated(answer: DetectResponse, mesh: Mesh) -> trimesh.Scene:
    body = MESH_WRITERS["glb"].body(mesh.vertices, mesh.faces, answer.mesh.bounds)
    return trimesh.load(io.BytesIO(glb.annotated_head(answer, body) + body), file_type="glb", process=False)


def in_place(scene: trimesh.Scene, name: str) -> trimesh.Trimesh:
    matrix, geometry = scene.graph[name]
    return scene.geometry[geometry].copy().apply_transform(matrix)


@pytest.mark.parametrize(
    ("accept", "format"),
    [
        (None, "json"),
        ("", "json"),
        ("*/*", "json"),
        ("application/*", "json"),
        ("text/*", "csv"),
        ("text/plain", "shrec"),
        ("model/gltf-binary", "glb"),
        ("MODEL/GLTF-Binary", "glb"),
        ("text/html, application/xhtml+xml, */*;q=0.8", "json"),
        ("application/json;q=0.2, text/csv;q=0.9", "csv"),
        ("application/json;q=0, */*", "glb"),
        ("text/csv;q=0.5, text/plain; charset=utf-8; q=0.7", "shrec"),
        ("application/vnd.prsnet.bop+json", "bop"),
        ("image/png", None),
        ("application/json;q=0", None),
        ("application/json;q=nan", None),
        ("application/json;q=x", None),
    ],
)
def test_accept(accept: str | None, format: str | None) -> None:
    choice = choose(None, accept)
    assert (choice and choice.output.name) == format
    assert choice is None or MEDIA_TYPES[choice.media_type] is choice.output


def test_format_in_the_query_is_heard_before_accept() -> None:
    chosen = choose("csv", "image/png")
    assert chosen is not None
    assert (chosen.output.name, chosen.media_type) == ("csv", "text/csv")
    entry = choose("bop", None)
    assert entry is not None
    assert entry.media_type == "application/json"


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("offset", [0.0, 4.5e6])
def test_a_written_mesh_is_the_mesh(kind: Any, offset: float) -> None:
    mesh = as_mesh(DATA / "chair.obj")
    vertices = mesh.vertices + offset
    again = reread(MESH_WRITERS[kind].file(vertices, mesh.faces), kind)
    # Only STL has nowhere to keep the digits of a place so far away.
    precision = {"ply": 0.0, "obj": 0.0, "glb": 1e-7 + 1e-15 * offset, "stl": 1e-7 * (1.0 + offset)}[kind]
    assert np.abs(again.triangles - vertices[mesh.faces]).max() <= precision
    if kind in ("ply", "obj"):
        assert (again.faces == mesh.faces).all()


def test_a_file_is_head_and_body_and_the_head_knows_the_size() -> None:
    mesh = as_mesh(DATA / "chair.obj")
    bounds = bounds_of(mesh.vertices, mesh.faces)
    for writer in MESH_WRITERS.values():
        body = writer.body(mesh.vertices, mesh.faces, bounds)
        expected = writer.size(len(mesh.vertices), len(mesh.faces))
        assert len(body) == expected or (writer.varies and len(body) <= expected)


def lies() -> list[Any]:
    number, index = np.float32(np.nan).tobytes(), (10**6).to_bytes(4, "little")
    return [
        ("ply", lambda body: body[:-1]),
        ("ply", lambda body: np.float64(np.inf).tobytes() + body[8:]),
        ("ply", lambda body: body[:-4] + index),
        ("ply", lambda body: body[:-13] + b"\4" + body[-12:]),
        ("glb", lambda body: body + b"\0\0\0\0"),
        ("glb", lambda body: number + body[4:]),
        ("glb", lambda body: body[:-4] + index),
        ("stl", lambda body: body[:12] + number + body[16:]),
        ("stl", lambda body: b""),
        ("obj", lambda body: b"mtllib x\n" + body),
        ("obj", lambda body: body.replace(b"v ", b"v nan ", 1)),
        ("obj", lambda body: body + b"f 1 2 3\n"),
    ]


@pytest.mark.parametrize(("kind", "change"), lies())
def test_a_body_that_lies_gets_no_head(kind: Any, change: Any) -> None:
    mesh = as_mesh(DATA / "chair.obj")
    bounds = bounds_of(mesh.vertices, mesh.faces)
    counts = Counts(len(mesh.vertices), len(mesh.faces), bounds)
    body = MESH_WRITERS[kind].body(mesh.vertices, mesh.faces, bounds)
    assert MESH_WRITERS[kind].head(counts, body)
    with pytest.raises(BodyError):
        MESH_WRITERS[kind].head(counts, change(body))


def test_stl_refuses_what_it_cannot_hold_and_glb_scales_it() -> None:
    mesh = as_mesh(DATA / "chair.obj")
    vertices = mesh.vertices * 1e50
    with pytest.raises(DegenerateMeshError, match="STL"):
        MESH_WRITERS["stl"].file(vertices, mesh.faces)
    again = reread(MESH_WRITERS["glb"].file(vertices, mesh.faces), "glb")
    assert np.abs(again.triangles - vertices[mesh.faces]).max() < 1e-6 * 1e50


@pytest.mark.parametrize("name", ["chair.obj", "vase.ply", "donut.gltf", "plant.off"])
def test_annotated_glb_has_the_mesh_and_every_element_in_its_place(name: str, answers: dict[str, Any]) -> None:
    answer, mesh = answers[name]
    scene = annotated(answer, mesh)
    names = ["mesh"]
    names += [f"plane {i}" for i in range(len(answer.planes))] + [f"axis {i}" for i in range(len(answer.axes))]
    assert sorted(scene.graph.nodes_geometry) == sorted(names)
    low, high = np.array(answer.mesh.bounds)
    assert np.allclose(in_place(scene, "mesh").bounds, [low, high], atol=1e-6)
    corners = np.array(list(itertools.product(*zip(low, high, strict=True))))
    for index, plane in enumerate(answer.planes):
        quad = in_place(scene, f"plane {index}")
        heights = quad.vertices @ np.array(plane.normal) + plane.offset
        assert np.abs(heights).max() < 1e-6
        assert np.abs(quad.face_normals @ np.array(plane.normal)).min() == pytest.approx(1.0)
        # The quad is large enough: the shadow of every corner of the box lies within it.
        shadow = corners - np.outer(corners @ np.array(plane.normal) + plane.offset, plane.normal)
        sides = quad.vertices[[1, 3]] - quad.vertices[0]
        shares = (shadow - quad.vertices[0]) @ sides.T / (sides**2).sum(axis=1)
        assert shares.min() > 0.0
        assert shares.max() < 1.0
    for index, axis in enumerate(answer.axes):
        rod = in_place(scene, f"axis {index}")
        off = np.cross(rod.vertices - np.array(axis.point), axis.direction)
        assert np.linalg.norm(off, axis=1).max() < 0.01 * answer.frame.scale
        along = (rod.vertices - np.array(axis.point)) @ np.array(axis.direction)
        assert np.ptp(along) == pytest.approx(1.2 * answer.frame.scale)
        assert rod.is_watertight
        assert rod.volume > 0


def test_glb_is_what_the_format_prescribes(answers: dict[str, Any]) -> None:
    answer, mesh = answers["vase.ply"]
    body = MESH_WRITERS["glb"].body(mesh.vertices, mesh.faces, answer.mesh.bounds)
    data = glb.annotated_head(answer, body) + body
    assert (data[:4], int.from_bytes(data[4:8], "little")) == (b"glTF", 2)
    assert int.from_bytes(data[8:12], "little") == len(data)
    size = int.from_bytes(data[12:16], "little")
    document = json.loads(data[20 : 20 + size])
    assert size % 4 == 0
    assert int.from_bytes(data[20 + size : 24 + size], "little") == document["buffers"][0]["byteLength"]
    for accessor in document["accessors"]:
        view = document["bufferViews"][accessor["bufferView"]]
        width = {5123: 2, 5125: 4, 5126: 4}[accessor["componentType"]]
        assert view["byteOffset"] % width == 0
        assert view["byteLength"] == accessor["count"] * width * (3 if accessor["type"] == "VEC3" else 1)
        assert view["byteOffset"] + view["byteLength"] <= document["buffers"][0]["byteLength"]
        assert accessor["type"] == "SCALAR" or len(accessor["min"]) == len(accessor["max"]) == 3
    assert "uri" not in json.dumps(document)
    assert document["nodes"][1]["extras"]["normal"] == answer.planes[0].normal


def test_unused_vertices_that_are_no_numbers_do_not_reach_a_file() -> None:
    mesh = as_mesh(DATA / "chair.obj")
    vertices = np.concatenate([mesh.vertices, [[np.nan, 0, 1e300]]])
    again = reread(MESH_WRITERS["glb"].file(vertices, mesh.faces), "glb")
    assert np.isfinite(again.vertices).all()


def test_shrec_is_what_its_evaluation_reads(answers: dict[str, Any]) -> None:
    answer = answers["vase.ply"][0]
    lines = shrec.write(answer, OutputOptions(4e-4)).decode().splitlines()
    assert int(lines[0]) == len(lines) - 1 == 8
    rows = np.array([line.split() for line in lines[1:]], dtype=float)
    assert rows.shape == (8, 7)
    for row, plane in zip(rows, answer.planes, strict=True):
        assert row[:3].tolist() == plane.normal
        assert abs(row[:3] @ row[3:6] + plane.offset) < 1e-9
    assert (np.diff(rows[:, 6]) <= 0).all()
    assert ((rows[:, 6] > 0) & (rows[:, 6] <= 1)).all()
    assert shrec.write(answers["plant.off"][0], OutputOptions(4e-4)) == b"0\n"
    assert shrec.confidence(0.0, 1e-3) == 1.0
    assert shrec.confidence(2e-3, 1e-3) == 0.0


def test_csv_has_a_row_for_everything(answers: dict[str, Any]) -> None:
    chosen = [answers[name][0] for name in ("vase.ply", "plant.off", "donut.gltf")]
    rows = list(csv.DictReader(io.StringIO(csv_rows.write(chosen).decode(), newline="")))
    expected = sum(max(1, len(answer.planes) + len(answer.axes)) for answer in chosen)
    assert len(rows) == expected
    first = rows[0]
    assert (first["file"], first["point_group"], first["kind"]) == ("vase.ply", "C8v", "plane")
    assert [float(first[name]) for name in "xyz"] == chosen[0].planes[0].normal
    assert float(first["offset"]) == chosen[0].planes[0].offset
    axis = next(row for row in rows if row["kind"] == "axis")
    assert (axis["order"], axis["offset"], axis["continuous"]) == ("8", "", "no")
    assert [row["kind"] for row in rows if row["file"] == "plant.off"] == ["none"]


def test_bop_entry_turns_the_model_onto_itself(answers: dict[str, Any]) -> None:
    answer, mesh = answers["table.glb"]
    entry = json.loads(bop.write(answer))
    assert [entry[f"min_{axis}"] for axis in "xyz"] == pytest.approx(mesh.bounds[0].tolist())
    assert [entry[f"size_{axis}"] for axis in "xyz"] == pytest.approx(np.ptp(mesh.bounds, axis=0).tolist())
    assert "symmetries_continuous" not in entry
    (flat,) = entry["symmetries_discrete"]
    matrix = np.reshape(flat, (4, 4))
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1.0)
    moved = mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]
    assert np.allclose(np.sort(moved, axis=0), np.sort(mesh.vertices, axis=0), atol=1e-5)
    pairs = np.linalg.norm(mesh.vertices[:, None] - mesh.vertices[None], axis=2)
    assert entry["diameter"] == pytest.approx(pairs.max())
    boxes = {f"{kind}_{axis}" for kind in ("min", "size") for axis in "xyz"}
    assert set(json.loads(bop.write(answers["plant.off"][0]))) == {"diameter", *boxes}


def test_files_are_named_after_what_came() -> None:
    from app.http.attachment import disposition

    assert disposition("chair.obj", ".glb") == 'attachment; filename="chair.glb"'
    header = disposition('stuhl "ä"\r\nx.obj', "-completed.ply")
    assert "\r" not in header
    assert header.startswith('attachment; filename="stuhl______x-completed.ply"; ')
    assert header.endswith("filename*=UTF-8''stuhl%20%22%C3%A4%22%0D%0Ax-completed.ply")
