"""Formats and completed meshes over HTTP, with a detector whose answer is known."""

import io
import json
from typing import Any

import numpy as np
import pytest
import trimesh

from app.http.attachment import Attachment
from tests.app.fakes import FakeDetector, Serving

pytestmark = pytest.mark.anyio


def files(chair: bytes, name: str = "chair.obj") -> dict[str, Any]:
    return {"file": (name, chair)}


@pytest.mark.parametrize(
    ("format", "media_type"),
    [
        ("json", "application/json"),
        ("bop", "application/json"),
        ("csv", "text/csv; charset=utf-8"),
        ("shrec", "text/plain; charset=utf-8"),
        ("glb", "model/gltf-binary"),
    ],
)
async def test_format_by_query(
    serving: Serving, detector: FakeDetector, chair: bytes, format: str, media_type: str
) -> None:
    async with serving(detector) as (client, _):
        response = await client.post("/detect", files=files(chair), params={"format": format})
        accept = "application/vnd.prsnet.bop+json" if format == "bop" else media_type
        by_accept = await client.post("/detect", files=files(chair), headers={"Accept": accept})
    assert response.status_code == by_accept.status_code == 200
    assert response.headers["content-type"] == media_type
    assert response.headers["vary"] == "Accept"
    assert int(response.headers["content-length"]) == len(response.content)
    if format not in ("json", "glb"):  # which tell the time
        assert response.content == by_accept.content


async def test_what_cannot_be_had_is_said(
    serving: Serving, detector: FakeDetector, chair: bytes, assert_problem: Any
) -> None:
    async with serving(detector) as (client, _):
        refused = await client.post("/detect", files=files(chair), headers={"Accept": "image/png"})
        assert "model/gltf-binary" in assert_problem(refused, "not-acceptable", 406)["detail"]
        assert refused.headers["vary"] == "Accept"
        unknown = await client.post("/detect", files=files(chair), params={"format": "png"})
        assert_problem(unknown, "invalid-parameter", 400)
    assert detector.calls == []


async def test_bop_entry_needs_no_include(serving: Serving, detector: FakeDetector, chair: bytes) -> None:
    async with serving(detector) as (client, _):
        entry = (await client.post("/detect?format=bop", files=files(chair))).json()
        answer = (await client.post("/detect?include=bop", files=files(chair))).json()
    assert entry["symmetries_discrete"] == answer["bop"]["symmetries_discrete"]
    assert entry["size_y"] == answer["mesh"]["bounds"][1][1] - answer["mesh"]["bounds"][0][1]


@pytest.mark.parametrize("format", ["ply", "glb", "obj", "stl"])
async def test_a_completed_mesh_comes_as_a_file(
    serving: Serving, detector: FakeDetector, chair: bytes, format: str
) -> None:
    half = "".join(line for line in chair.decode().splitlines(True) if not line.startswith("f")) + "f 1 2 3\nf 4 5 6\n"
    async with serving(detector) as (client, _):
        response = await client.post(
            "/complete",
            files=files(half.encode(), "some/Ä half.obj"),
            params={"format": format, "normal": "0,-3,0", "offset": 3.0},
        )
    assert response.status_code == 200, response.text
    done = json.loads(response.headers["prsnet-completion"])
    assert done["plane"]["normal"] == [0.0, -1.0, 0.0]
    assert done["plane"]["offset"] == 1.0
    assert done["plane"]["detected"] is False
    assert done["faces_kept"] == done["faces_added"] == 2
    assert done["area_added"] == pytest.approx(1.0)
    name = response.headers["content-disposition"]
    assert (
        name == f"attachment; filename=\"__half-completed.{format}\"; filename*=UTF-8''%C3%84%20half-completed.{format}"
    )
    mesh = trimesh.load(io.BytesIO(response.content), file_type=format, process=False, force="mesh")
    assert len(mesh.faces) == 4
    heights = np.sort(mesh.triangles_center[:, 1])
    assert heights[:2] + heights[:1:-1] == pytest.approx(2.0, abs=1e-5)
    assert "server-timing" in response.headers
    assert "complete;dur=" in response.headers["server-timing"]
    assert detector.calls == []  # the plane was given


async def test_without_a_plane_the_best_one_is_taken(serving: Serving, detector: FakeDetector, chair: bytes) -> None:
    async with serving(detector) as (client, _):
        response = await client.post("/complete?max_error=2e-3", files=files(chair))
    done = json.loads(response.headers["prsnet-completion"])
    assert done["plane"]["detected"] is True
    assert done["plane"]["normal"] == [1.0, 0.0, 0.0]
    assert (done["faces_added"], done["area_added"]) == (0, 0.0)
    assert [(call["mode"], call["max_error"]) for call in detector.calls] == [("full", 2e-3)]


@pytest.mark.parametrize(
    ("query", "parameter"),
    [
        ("normal=1,2", "normal"),
        ("normal=0,0,0", "normal"),
        ("normal=1,nan,0", "normal"),
        ("normal=a,b,c", "normal"),
        ("normal=1,2,3,4", "normal"),
        ("offset=1", "offset"),
        ("normal=1,0,0&offset=inf", "offset"),
        ("format=off", "format"),
        ("max_error=0", "max_error"),
        ("mode=paper", "mode"),
    ],
)
async def test_parameters_are_checked(
    serving: Serving, detector: FakeDetector, chair: bytes, assert_problem: Any, query: str, parameter: str
) -> None:
    async with serving(detector) as (client, _):
        response = await client.post(f"/complete?{query}", files=files(chair))
    document = assert_problem(response, "invalid-parameter", 400)
    assert [error["parameter"] for error in document["errors"]] == [parameter]
    assert "Value error" not in document["detail"]


async def test_an_answer_larger_than_allowed_is_a_problem(
    serving: Serving, detector: FakeDetector, chair: bytes, assert_problem: Any
) -> None:
    async with serving(detector, max_answer_bytes=2048) as (client, runtime):
        for path in ("/detect?format=glb", "/complete?format=obj", "/complete?format=stl"):
            problem = assert_problem(await client.post(path, files=files(chair)), "mesh-too-large", 413)
            assert "2048 bytes" in problem["detail"]
        assert (await client.post("/detect", files=files(chair))).status_code == 200
        assert runtime.sending_bytes == 0
    async with serving(detector, sending_bytes=2048) as (client, runtime):
        response = await client.post("/detect?format=glb", files=files(chair))
        assert_problem(response, "overloaded", 503)
        assert response.headers["retry-after"] == "5"
        assert runtime.sending_bytes == 0


async def test_bytes_on_their_way_are_counted_until_they_are_sent() -> None:
    ended: list[bool] = []
    sent: list[dict[str, Any]] = []
    data = bytes(range(256)) * 5000

    async def send(message: Any) -> None:
        assert not ended
        sent.append(message)

    attachment = Attachment(
        [b"head", data], {"X": "y"}, "model/stl", stall_s=5, seconds=5, on_end=lambda: ended.append(True)
    )
    await attachment({}, None, send)  # type: ignore[arg-type]
    assert ended == [True]
    assert b"".join(message.get("body", b"") for message in sent) == b"head" + data
    assert (b"content-length", str(4 + len(data)).encode()) in sent[0]["headers"]
    assert len(sent) > 5


async def test_a_client_that_does_not_read_is_left() -> None:
    import asyncio

    from starlette.requests import ClientDisconnect

    ended: list[bool] = []

    async def send(message: Any) -> None:
        if message["type"] == "http.response.body":
            await asyncio.sleep(30)

    attachment = Attachment([b"head"], {}, "model/stl", stall_s=0.05, seconds=5, on_end=lambda: ended.append(True))
    with pytest.raises(ClientDisconnect):
        await attachment({}, None, send)  # type: ignore[arg-type]
    assert ended == [True]


async def test_the_catalogue_of_routes_knows_complete(serving: Serving, detector: FakeDetector, chair: bytes) -> None:
    async with serving(detector) as (client, _):
        await client.post("/complete", files=files(chair))
        text = (await client.get("/metrics")).text
    assert 'prsnet_requests_total{method="POST",route="/complete",status="200"} 1.0' in text
    assert "prsnet_sending_bytes 0.0" in text
