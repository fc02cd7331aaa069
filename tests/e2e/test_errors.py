"""Every error class of the contract, from a real server; and the server goes on serving."""

import io
import json
import os
import select
import signal
import socket
import struct
import threading
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from tests import load

from .server import Server


@pytest.fixture(autouse=True)
def still_serving(server: Server, data: Path) -> Iterator[None]:
    """Whatever a test sends, the next request is answered."""
    yield
    assert server.health() == 200
    assert server.detect("chair.obj", (data / "chair.obj").read_bytes()).status_code == 200


def check_problem(response: httpx.Response, slug: str, status: int) -> dict[str, Any]:
    assert response.headers["content-type"] == "application/problem+json", response.text
    document = response.json()
    assert (document["type"], response.status_code) == (f"/problems/{slug}", status), document
    assert document["request_id"] == response.headers["x-request-id"]
    assert len(document["detail"]) > 10
    return document


def ply(vertices: list[list[float]], faces: list[list[int]]) -> bytes:
    header = (
        f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = [" ".join(map(str, row)) for row in vertices] + [" ".join(map(str, [len(f), *f])) for f in faces]
    return (header + "\n".join(rows) + "\n").encode()


def binary_stl(triangles: Any, announced: int | None = None) -> bytes:
    triangles = np.asarray(triangles, dtype="<f4").reshape(-1, 9)
    records = b"".join(struct.pack("<3f", 0, 0, 0) + row.tobytes() + b"\0\0" for row in triangles)
    return b"\0" * 80 + struct.pack("<I", len(triangles) if announced is None else announced) + records


def zip_of(**members: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return out.getvalue()


SQUARE = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]
TRIANGLE = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("notes.docx", b"PK\x03\x04 text"),
        ("mesh", b"v 0 0 0\n"),
        ("mesh.blend", b"BLENDER"),
        ("mesh.obj.gz", b"\x1f\x8b\x08"),
        ("really_a_ply.stl", ply(SQUARE, [[0, 1, 2]])),
        ("really_a_glb.obj", b"glTF\x02\0\0\0" + b"\0" * 64),
    ],
)
def test_unsupported_format(server: Server, name: str, content: bytes) -> None:
    check_problem(server.detect(name, content), "unsupported-format", 415)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("short.stl", binary_stl([TRIANGLE], announced=2)),
        ("huge.stl", binary_stl([TRIANGLE], announced=2**32 - 1)),
        ("junk.obj", bytes(range(256)) * 4),
        ("junk.off", b"OFF\nthree points\n"),
        ("short.off", b"OFF\n4 1 0\n0 0 0\n"),
        ("short.ply", ply(SQUARE, [[0, 1, 2]])[:-20]),
        ("huge.ply", ply(SQUARE, [[0, 1, 2]]).replace(b"vertex 4", b"vertex 4000000")),
        ("junk.glb", b"glTF\x02\0\0\0" + struct.pack("<I", 1000) + b"{}"),
        ("junk.gltf", b'{"asset": {"version": "2.0"'),
        ("outside.gltf", json.dumps({
            "asset": {"version": "2.0"}, "buffers": [{"uri": "../../etc/passwd", "byteLength": 36}],
            "bufferViews": [{"buffer": 0, "byteLength": 36}],
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "nodes": [{"mesh": 0}],
            "scenes": [{"nodes": [0]}], "scene": 0,
        }).encode()),
        ("junk.3mf", b"PK\x03\x04" + b"\0" * 40),
        ("other.3mf", zip_of(readme=b"no model here")),
    ],
)  # fmt: skip
def test_unreadable_mesh(server: Server, name: str, content: bytes) -> None:
    check_problem(server.detect(name, content), "unreadable-mesh", 422)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("points.ply", ply(SQUARE, [])),
        ("points.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
        ("none.stl", binary_stl([])),
        ("none.off", b"OFF\n0 0 0\n"),
    ],
)
def test_mesh_without_faces(server: Server, name: str, content: bytes) -> None:
    check_problem(server.detect(name, content), "empty-mesh", 422)


@pytest.mark.parametrize("name", ["a.stl", "a.obj", "a.ply", "a.off", "a.glb", "a.gltf", "a.3mf"])
def test_file_of_no_bytes(server: Server, name: str) -> None:
    response = server.detect(name, b"")
    assert response.status_code == 422
    check_problem(response, response.json()["type"].rsplit("/", 1)[1], 422)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("nan.stl", binary_stl([[[NAN, 0, 0], [1, 0, 0], [0, 1, 0]]])),
        ("inf.stl", binary_stl([[[INF, 0, 0], [1, 0, 0], [0, 1, 0]]])),
        ("nan.ply", ply([[NAN, 0, 0], *SQUARE], [[0, 1, 2]])),
        ("point.stl", binary_stl([[[1, 2, 3]] * 3])),
        ("line.obj", b"v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\n"),
        ("index.ply", ply(SQUARE, [[0, 1, 99]])),
        ("index.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n"),
    ],
)
def test_degenerate_mesh(server: Server, name: str, content: bytes) -> None:
    check_problem(server.detect(name, content), "degenerate-mesh", 422)


def test_malformed_requests(server: Server) -> None:
    url, chair = f"{server.url}/detect", ("a.obj", b"v 0 0 0\n")
    for response in (
        httpx.post(url),
        httpx.post(url, json={"file": "a.obj"}),
        httpx.post(url, content=b"v 0 0 0", headers={"content-type": "model/obj"}),
        httpx.post(url, files={"mesh": chair}),
        httpx.post(url, files=[("file", chair), ("file", chair)]),
        httpx.post(url, files={"file": chair}, data={"mode": "paper"}),
        httpx.post(url, data={"file": "a.obj"}, files={"x": chair}),
    ):
        check_problem(response, "malformed-request", 400)


def test_bad_parameters_addresses_and_methods(server: Server) -> None:
    check_problem(server.detect("a.obj", b"", mode="quick"), "invalid-parameter", 400)
    check_problem(server.detect("a.obj", b"", tolerance=1), "invalid-parameter", 400)
    check_problem(httpx.get(f"{server.url}/nothing"), "not-found", 404)
    check_problem(httpx.get(f"{server.url}/detect"), "method-not-allowed", 405)
    check_problem(httpx.delete(f"{server.url}/health"), "method-not-allowed", 405)
    check_problem(httpx.get(f"{server.url}/static/../settings.py"), "not-found", 404)


def test_mesh_over_the_face_limit(strict_server: Server) -> None:
    content = binary_stl(np.random.default_rng(1).random((400_001, 9)))
    document = check_problem(strict_server.detect("many.stl", content), "mesh-too-large", 413)
    assert "400000" in document["detail"].replace(",", "").replace(" ", "").replace("_", "")


def test_declared_length_over_the_limit_is_answered_before_the_body_is_sent(strict_server: Server) -> None:
    head = (
        "POST /detect HTTP/1.1\r\nHost: t\r\nContent-Type: multipart/form-data; boundary=b\r\n"
        "Content-Length: 50000001\r\nExpect: 100-continue\r\n\r\n"
    )
    with socket.create_connection(("127.0.0.1", strict_server.port), timeout=30) as connection:
        connection.sendall(head.encode())
        answer = connection.recv(65536)
    assert answer.startswith(b"HTTP/1.1 413 ")
    assert b"application/problem+json" in answer


def test_limit_holds_while_a_chunked_body_without_length_streams_in(strict_server: Server) -> None:
    limit, block = 50_000_000, 1_000_000
    head = (
        "POST /detect HTTP/1.1\r\nHost: t\r\nContent-Type: multipart/form-data; boundary=b\r\n"
        "Transfer-Encoding: chunked\r\n\r\n"
    )
    first = b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.stl"\r\n\r\n'
    sent = 0
    with socket.create_connection(("127.0.0.1", strict_server.port), timeout=30) as connection:
        connection.sendall(head.encode() + b"%x\r\n" % len(first) + first + b"\r\n")
        chunk = b"%x\r\n" % block + b"\0" * block + b"\r\n"
        while not select.select([connection], [], [], 0)[0] and sent < 4 * limit:
            connection.sendall(chunk)
            sent += block
        answer = b""
        while not answer.endswith(b"}") and (piece := connection.recv(65536)):  # headers and body come apart
            answer += piece
    assert answer.startswith(b"HTTP/1.1 413 ")
    assert b"/problems/upload-too-large" in answer
    assert sent < 2 * limit  # the rest is what socket buffers hold


def test_overload_is_refused_and_told_when_to_come_back(strict_server: Server, data: Path) -> None:
    chair = (data / "chair.obj").read_bytes()
    answers: list[httpx.Response] = []
    workers = load.workers_of(strict_server.process.pid)
    assert workers
    for worker in workers:
        os.kill(worker, signal.SIGSTOP)  # what is sent to them now stays unanswered, however fast the machine is
    try:
        running = threading.Thread(target=lambda: answers.append(strict_server.detect("chair.obj", chair)))
        running.start()
        end = time.monotonic() + 60
        while "prsnet_jobs_running 1.0" not in httpx.get(f"{strict_server.url}/metrics", timeout=60).text:
            assert time.monotonic() < end
            time.sleep(0.01)
        refused = strict_server.detect("chair.obj", chair)
        check_problem(refused, "overloaded", 503)
        assert int(refused.headers["retry-after"]) >= 1
    finally:
        for worker in workers:
            os.kill(worker, signal.SIGCONT)
    running.join()
    assert [answer.status_code for answer in answers] == [200]
    assert strict_server.detect("chair.obj", chair).status_code == 200
