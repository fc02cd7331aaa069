"""What the server makes of bytes it has no reason to trust: a worker's answers, a client's forms."""

import asyncio
import contextlib
import json
import math
import socket
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from fastapi import Request
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from app.http.openapi import _EXAMPLE_RESPONSE
from app.http.uploads import read_upload
from app.outputs.registry import MESH_WRITERS
from app.problems import ProblemError
from app.settings import Settings
from app.workers import wire
from app.workers.verify import UntrustedError, trusted, trusted_answer, trusted_error
from app.workers.wire import Job
from app.workers.zygote_client import Card
from model.errors import DegenerateMeshError, EmptyMeshError
from model.formats import read_mesh

FUZZ = settings(
    max_examples=150, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck)
)
JOB = Job("chair.obj", "full", 4e-4, [], 1000, 1000, 10, 1000, 1.0, 0, "inline")
CARD = Card("prs-net", "1", "0" * 64, {}, ["obj"], 1)
AXIS = {
    "direction": [0.0, 0.0, 1.0], "point": [0.0, 0.0, 0.0], "order": None, "continuous": True, "matrix": None,
    "symmetry_error": 0.0, "rms_distance": 0.0, "max_distance": 0.0, "coverage": 1.0, "confidence": None,
    "exact": True,
}  # fmt: skip


def good() -> dict[str, Any]:
    return json.loads(json.dumps({**_EXAMPLE_RESPONSE, "axes": [AXIS]}))


def test_an_honest_answer_passes() -> None:
    assert trusted_answer(json.dumps(good()).encode(), JOB, CARD).mesh.faces == 260


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("mesh", "filename"), "other.obj"),
        (("mesh", "format"), "exe"),
        (("mesh", "faces"), 1001),
        (("mesh", "faces"), -1),
        (("mesh", "vertices"), 10**9),
        (("model", "sha256"), "1" * 64),
        (("point_group",), "<script>"),
        (("warnings",), ["line\nbreak"]),
        (("warnings",), ["x"] * 101),
        (("warnings",), ["x" * 501]),
        (("frame", "units"), "\x1b[2J"),
        (("frame", "scale"), math.inf),
        (("frame", "scale"), 1e90),
        (("frame", "center"), [math.nan, 0, 0]),
        (("planes", 0, "normal"), [2.0, 0, 0]),
        (("planes", 0, "normal"), [1.0, 0]),
        (("planes", 0, "offset"), -1e90),
        (("planes", 0, "symmetry_error"), -1e-9),
        (("planes", 0, "exact"), "<b>"),
        (("axes", 0, "order"), 3),
        (("axes", 0, "matrix"), [[1.0] * 4] * 4),
        (("timings_ms", "total"), 1e12),
        (("planes",), None),
        (("surprise",), 1),
    ],
)
def test_a_lie_does_not_pass(path: tuple[str | int, ...], value: Any) -> None:
    answer = good()
    inner = answer
    for step in path[:-1]:
        inner = inner[step]
    inner[path[-1]] = value
    with pytest.raises(UntrustedError):
        trusted_answer(json.dumps(answer).encode(), JOB, CARD)


def test_more_elements_than_can_be_do_not_pass() -> None:
    answer = good()
    answer["planes"] *= 10_001
    with pytest.raises(UntrustedError):
        trusted_answer(json.dumps(answer).encode(), JOB, CARD)


COMPLETION = {
    "completion": {
        "plane": {"normal": [1.0, 0.0, 0.0], "offset": 0.0, "detected": True, "symmetry_error": 0.0},
        "vertices_kept": 3, "faces_kept": 1, "vertices_added": 0, "faces_added": 0, "area_added": 0.0,
        "tolerance": 0.0, "seam_distance": 0.0, "symmetrized": False,
    },
    "mesh": {
        "filename": "chair.obj", "format": "obj", "vertices": 3, "faces": 1, "watertight": False,
        "bounds": [[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]],
    },
    "timings_ms": _EXAMPLE_RESPONSE["timings_ms"],
    "complete_ms": 1.0,
}  # fmt: skip
COMPLETE = replace(JOB, task="complete", geometry="ply", max_answer_bytes=1000)
TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
BODY = MESH_WRITERS["ply"].body(TRIANGLE, np.array([[0, 1, 2]], dtype=np.int32), [])


def test_an_honest_completion_passes_and_its_file_is_written_by_the_server() -> None:
    answer = trusted(json.dumps(COMPLETION).encode(), BODY, COMPLETE, CARD)
    head, body = answer.file
    assert head.startswith(b"ply\nformat binary_little_endian")
    assert body is BODY


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("mesh", "filename"), "other.obj"),
        (("mesh", "vertices"), 4),
        (("mesh", "faces"), 2),
        (("mesh", "faces"), 10**9),
        (("mesh", "bounds"), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
        (("mesh", "bounds"), [[-1e90, 0.0, 0.0], [0.0, 1.0, 0.0]]),
        (("completion", "plane", "normal"), [1.0, 1.0, 0.0]),
        (("completion", "plane", "detected"), False),
        (("completion", "plane", "symmetry_error"), math.nan),
        (("completion", "symmetrized"), True),
        (("completion", "faces_added"), 10**12),
        (("completion", "area_added"), 1e300),
        (("completion", "note"), "Set-Cookie: x"),
        (("complete_ms",), 1e12),
        (("planes",), []),
    ],
)
def test_a_lie_about_a_completion_does_not_pass(path: tuple[str, ...], value: Any) -> None:
    content = json.loads(json.dumps(COMPLETION))
    inner = content
    for step in path[:-1]:
        inner = inner[step]
    inner[path[-1]] = value
    with pytest.raises(UntrustedError):
        trusted(json.dumps(content).encode(), BODY, COMPLETE, CARD)


@FUZZ
@given(st.data())
def test_no_bytes_of_a_geometry_are_a_defect(data: st.DataObject) -> None:
    place = data.draw(st.integers(0, len(BODY)))
    changed = BODY[:place] + data.draw(st.binary(max_size=8)) + BODY[place + data.draw(st.integers(0, 12)) :]
    try:
        answer = trusted(json.dumps(COMPLETION).encode(), changed, COMPLETE, CARD)
    except UntrustedError:
        return
    with contextlib.suppress(DegenerateMeshError):  # a number may be any number
        assert len(read_mesh(b"".join(answer.file), "x.ply").faces) == 1


@FUZZ
@given(st.data())
def test_no_bytes_of_an_answer_are_a_defect(data: st.DataObject) -> None:
    body = json.dumps(good()).encode()
    place = data.draw(st.integers(0, len(body)))
    changed = body[:place] + data.draw(st.binary(max_size=8)) + body[place + data.draw(st.integers(0, 30)) :]
    try:
        answer = trusted_answer(changed, JOB, CARD)
    except UntrustedError:
        return
    assert answer.mesh.filename == "chair.obj"
    assert all(math.isfinite(number) for plane in answer.planes for number in [*plane.normal, plane.offset])


@pytest.mark.parametrize(
    "value", [None, [], ["EmptyMeshError"], ["MeshError", "x"], ["OSError", "x"], ["EmptyMeshError", ""], [1, 2]]
)
def test_an_error_that_is_none_does_not_pass(value: object) -> None:
    with pytest.raises(UntrustedError):
        trusted_error(value)
    assert isinstance(trusted_error(["EmptyMeshError", "It has no faces."]), EmptyMeshError)


def test_a_frame_is_refused_before_it_is_allocated() -> None:
    async def receive(content: bytes) -> tuple[bytes, bytes]:
        ours, theirs = socket.socketpair()
        ours.setblocking(False)
        with ours, theirs:
            theirs.sendall(content)
            theirs.shutdown(socket.SHUT_WR)
            return await wire.receive(ours, limit=1000)

    assert asyncio.run(receive(wire.frame(wire.ANSWER, b"x" * 1000))) == (wire.ANSWER, b"x" * 1000)
    with pytest.raises(wire.WireError):
        asyncio.run(receive(b"A\xff\xff\xff\xff"))
    for cut in (0, 3, 5, 100):
        with pytest.raises(EOFError):
            asyncio.run(receive(wire.frame(wire.ANSWER, b"x" * 1000)[:cut]))


PARTS = [
    b"--b", b"--b--", b"\r\n", b"\r\n\r\n", b"Content-Disposition: form-data", b'; name="file"', b'; filename="a.obj"',
    b'; filename="../\\"', b"; filename*=UTF-8''a.obj", b"Content-Type: x", b"v 0 0 0", b"\0", b"--", b"\xff",
]  # fmt: skip


@FUZZ
@given(st.lists(st.sampled_from(PARTS) | st.binary(max_size=10), max_size=25), st.integers(1, 40))
def test_any_form_is_an_upload_or_a_problem(parts: list[bytes], size: int) -> None:
    body = b"".join(parts)
    chunks = [body[at : at + size] for at in range(0, len(body), size)] or [b""]

    async def receive() -> dict[str, Any]:
        chunk = chunks.pop(0)
        return {"type": "http.request", "body": chunk, "more_body": bool(chunks)}

    headers = [(b"content-type", b"multipart/form-data; boundary=b")]
    scope = {"type": "http", "method": "POST", "path": "/detect", "headers": headers, "query_string": b""}
    try:
        upload = asyncio.run(read_upload(Request(scope, receive), Settings()))
    except ProblemError:
        return
    assert upload.filename
    assert not set("/\\\0") & set(upload.filename)


_MESH = {
    "filename": "chair.obj", "format": "obj", "vertices": 3, "faces": 1, "watertight": False,
    "bounds": [[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]],
}  # fmt: skip
_UNIT = [[1.0, 0.0, 0.0, 5.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
EDITED: dict[str, dict[str, Any]] = {
    "halve": {
        "half": {
            "normal": [1.0, 0.0, 0.0], "offset": 0.0, "detected": True, "side": "positive", "faces": 1,
            "points": [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        },
        "mesh": _MESH, "timings_ms": _EXAMPLE_RESPONSE["timings_ms"],
    },
    "sector": {
        "sector": {
            "order": 4, "angle": 90.0, "direction": [0.0, 0.0, 1.0], "ends": [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            "dependent": {"normal": [0.0, 1.0, 0.0], "offset": 0.0}, "max_distance": 0.0,
            "independent": {"normal": [1.0, 0.0, 0.0], "offset": 0.0}, "detected": True, "capped": False, "faces": 1,
        },
        "mesh": _MESH, "timings_ms": _EXAMPLE_RESPONSE["timings_ms"],
    },
    "align": {
        "alignment": {"matrix": _UNIT, "point_group": "Cs"},
        "mesh": _MESH, "timings_ms": _EXAMPLE_RESPONSE["timings_ms"],
    },
}  # fmt: skip


@pytest.mark.parametrize("task", EDITED)
def test_an_honest_edit_passes(task: Any) -> None:
    answer = trusted(json.dumps(EDITED[task]).encode(), BODY, replace(COMPLETE, task=task), CARD)
    assert answer.file[0].startswith(b"ply")


@pytest.mark.parametrize(
    ("task", "path", "value"),
    [
        ("halve", ("half", "normal"), [1.0, 1.0, 0.0]),
        ("halve", ("half", "detected"), False),
        ("halve", ("half", "side"), "negative"),
        ("halve", ("half", "faces"), 2),
        ("halve", ("half", "warnings"), ["two\nlines"]),
        ("halve", ("mesh", "filename"), "other.obj"),
        ("halve", ("half", "capped"), True),
        ("halve", ("half", "points"), [[1e90, 0.0, 0.0]] * 3),
        ("halve", ("half", "calculix"), "*INCLUDE, INPUT=/etc/passwd"),
        ("sector", ("sector", "freecad"), "import os"),
        ("sector", ("sector", "direction"), [0.0, 0.0, 2.0]),
        ("sector", ("sector", "dependent", "normal"), [0.0, 0.0, 2.0]),
        ("sector", ("sector", "independent", "offset"), 1e90),
        ("sector", ("sector", "ends"), [[0.0, 0.0, 1e90]] * 2),
        ("sector", ("sector", "order"), 5),
        ("sector", ("sector", "detected"), False),
        ("sector", ("sector", "capped"), True),
        ("sector", ("sector", "faces"), 2),
        ("sector", ("sector", "max_distance"), 1e90),
        ("sector", ("sector", "warnings"), ["two\nlines"]),
        ("align", ("alignment", "matrix"), [[1e90, 0.0, 0.0, 0.0], *_UNIT[1:]]),
        ("align", ("alignment", "matrix"), [[2.0, 0.0, 0.0, 0.0], *_UNIT[1:]]),
        ("align", ("alignment", "point_group"), "C1\r\nX: y"),
        ("align", ("alignment", "warnings"), ["\u00e9"]),
    ],
)
def test_a_lie_about_an_edit_does_not_pass(task: Any, path: tuple[str, ...], value: Any) -> None:
    content = json.loads(json.dumps(EDITED[task]))
    place = content
    for name in path[:-1]:
        place = place[name]
    place[path[-1]] = value
    with pytest.raises(UntrustedError):
        trusted(json.dumps(content).encode(), BODY, replace(COMPLETE, task=task), CARD)
