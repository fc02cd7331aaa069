"""The Python client against real servers: the service, and one that fails in ways the service hardly does."""

import asyncio
import io
import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from email.utils import formatdate
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import trimesh
import uvicorn

import app
from app import AsyncClient, Client, UnavailableError, UnexpectedAnswerError, UnreachableError, UnusableMeshError
from app.client.errors import ClientError, ProblemAnswerError, RequestError
from app.schemas import DetectResponse

from .server import ROOT, Server, running

Asgi = Callable[[Any, Any, Any], Any]


@pytest.fixture
def client(server: Server) -> Generator[Client, None, None]:
    with Client(server.url) as started:
        yield started


@contextmanager
def scripted(*answers: tuple[int, dict[str, str], bytes]) -> Generator[tuple[str, list[int]], None, None]:
    """A uvicorn that gives these answers in turn, the last one for ever; and the sizes of what it was sent."""
    received: list[int] = []

    async def serve(scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] != "http":
            return
        size, more = 0, True
        while more:
            message = await receive()
            size, more = size + len(message.get("body", b"")), message.get("more_body", False)
        status, headers, body = answers[min(len(received), len(answers) - 1)]
        received.append(size)
        raw = [(name.encode(), value.encode()) for name, value in headers.items()]
        await send({"type": "http.response.start", "status": status, "headers": raw})
        await send({"type": "http.response.body", "body": body})

    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        config = uvicorn.Config(serve, log_level="critical", lifespan="off")
        uvicorn_server = uvicorn.Server(config)
        thread = threading.Thread(target=uvicorn_server.run, kwargs={"sockets": [listener]})
        thread.start()
        try:
            yield f"http://127.0.0.1:{listener.getsockname()[1]}", received
        finally:
            uvicorn_server.should_exit = True
            thread.join()


def problem(status: int, slug: str) -> tuple[int, dict[str, str], bytes]:
    body = {"type": f"/problems/{slug}", "title": "T", "status": status, "detail": "D.", "request_id": "r"}
    return status, {"content-type": "application/problem+json"}, json.dumps(body).encode()


def without_times(answer: DetectResponse) -> dict[str, Any]:
    return answer.model_dump(exclude={"timings_ms", "mesh"})


def test_client_and_library_say_the_same(client: Client, data: Path) -> None:
    for name in ("chair.obj", "vase.ply", "plant.off"):
        remote = client.detect(data / name, include=["rejected", "bop"])
        local = app.detect(data / name, include=["rejected", "bop"])
        assert type(remote) is type(local) is DetectResponse
        assert remote.mesh == local.mesh
        assert without_times(remote) == without_times(local)


def test_a_mesh_in_memory_needs_no_file(client: Client, data: Path) -> None:
    mesh = trimesh.load(data / "table.glb", force="mesh", process=False)
    answers = [
        client.detect(mesh),
        client.detect((mesh.vertices, mesh.faces)),
        client.detect(("table.glb", (data / "table.glb").read_bytes())),
        client.detect(str(data / "table.glb")),
        app.detect(mesh),
        app.detect((mesh.vertices, mesh.faces)),
    ]
    assert {answer.point_group for answer in answers} == {"C2v"}
    for answer in answers:
        assert np.allclose(answer.planes[0].normal, answers[0].planes[0].normal, atol=1e-6)
        mirrored = mesh.copy().apply_transform(answer.planes[0].matrix)
        distances = trimesh.proximity.closest_point_naive(mesh, mirrored.triangles_center)[1]
        assert distances.max() < 1e-5
        turned = mesh.copy().apply_transform(answer.axes[0].matrix)
        assert trimesh.proximity.closest_point_naive(mesh, turned.triangles_center)[1].max() < 1e-5


def test_options_reach_the_service(client: Client, data: Path) -> None:
    assert client.detect(data / "chair.obj", mode="paper").timings_ms.refine == 0.0
    assert client.detect(data / "plant.off", max_error=0.02, include=["bop"]).planes
    assert client.detect(data / "chair.obj").bop is None


def test_exports(client: Client, data: Path) -> None:
    scene = trimesh.load(io.BytesIO(client.export(data / "vase.ply", "glb")), file_type="glb")
    assert {"mesh", "plane 7", "axis 0"} <= set(scene.graph.nodes_geometry)
    assert client.export(data / "vase.ply", "shrec").startswith(b"8\n")
    assert len(json.loads(client.export(data / "vase.ply", "bop"))["symmetries_discrete"]) == 7
    assert client.export(data / "vase.ply", "csv").count(b"vase.ply") == 9


@pytest.mark.parametrize("format", ["ply", "glb", "obj", "stl"])
def test_complete_gives_a_half_its_other_half(client: Client, data: Path, tmp_path: Path, format: Any) -> None:
    plane = app.detect(data / "chair.obj").planes[0]
    half = app.halve(data / "chair.obj", plane)
    remote = client.complete(half, plane=plane, format=format)
    local = app.complete(half, plane=[*plane.normal, plane.offset])
    assert remote.completion == local.completion
    assert remote.completion.area_added == pytest.approx(1.0)
    remote.save(tmp_path / f"remote.{format}")
    local.save(tmp_path / f"local.{format}")
    chair = trimesh.load(data / "chair.obj", force="mesh")
    for path in (tmp_path / f"remote.{format}", tmp_path / f"local.{format}"):
        mesh = trimesh.load(path, force="mesh")
        assert np.allclose(mesh.bounds, chair.bounds, atol=1e-5)
        assert mesh.area == pytest.approx(chair.area, rel=1e-4)
    with pytest.raises(ValueError, match=r"\.ply, \.glb"):
        local.save(tmp_path / "local.off")


def test_problems_are_exceptions(client: Client, data: Path, tmp_path: Path) -> None:
    with pytest.raises(UnusableMeshError, match="supported format") as unsupported:
        client.detect(("x.docx", b"x"))
    assert (unsupported.value.slug, unsupported.value.problem.status) == ("unsupported-format", 415)
    assert unsupported.value.problem.request_id
    with pytest.raises(UnusableMeshError, match="max_error") as planeless:
        client.complete(data / "plant.off")
    assert planeless.value.slug == "no-plane"
    with pytest.raises(RequestError, match="max_error"):
        client.detect(data / "chair.obj", max_error=7.0)
    with pytest.raises(FileNotFoundError):
        client.detect(tmp_path / "missing.obj")
    with pytest.raises(ValueError, match="four numbers"):
        client.complete(data / "chair.obj", plane=[1, 2, 3])
    with pytest.raises(app.UnusableMeshError):
        client.detect(("empty.obj", b"v 0 0 0\n"))


def test_every_error_of_the_client_has_one_root() -> None:
    for error in (UnreachableError, UnexpectedAnswerError, UnavailableError, UnusableMeshError, RequestError):
        assert issubclass(error, ClientError)
    assert issubclass(UnavailableError, ProblemAnswerError)


def test_state_and_card(client: Client) -> None:
    assert client.ready()
    card = client.model_card()
    assert "obj" in card.limits.formats
    assert card.name == "default"
    with Client("http://127.0.0.1:9", retries=0) as nobody:
        assert not nobody.ready()


def test_keys(tmp_path: Path, data: Path) -> None:
    with running(tmp_path / "log", API_KEYS="secret", WORKERS="1") as guarded:
        with Client(guarded.url) as stranger, pytest.raises(RequestError) as refused:
            stranger.detect(data / "chair.obj")
        assert refused.value.problem.status == 401
        with Client(guarded.url, api_key="secret") as friend:
            assert friend.detect(data / "chair.obj").point_group == "Cs"


def test_many_at_a_time_with_a_queue_that_is_too_short(strict_server: Server, data: Path) -> None:
    """Without a queue nearly all are refused at first; all get their answer, because the client comes back."""

    async def all_of_them() -> list[DetectResponse]:
        async with AsyncClient(strict_server.url, retries=20) as client:
            assert await client.ready()
            assert (await client.model_card()).name == "default"
            completed = await client.complete(data / "table.glb")
            assert completed.completion.faces_added == 0
            assert (await client.export(data / "vase.ply", "shrec")).startswith(b"8\n")
            return await asyncio.gather(*[client.detect(data / "chair.obj") for _ in range(6)])

    assert {answer.point_group for answer in asyncio.run(all_of_them())} == {"Cs"}


def test_retry_waits_as_long_as_the_service_asks(data: Path) -> None:
    status, headers, body = problem(503, "overloaded")
    answer = app.detect(data / "chair.obj").model_dump_json(by_alias=True, exclude={"rejected", "bop"}).encode()
    good = (200, {"content-type": "application/json"}, answer)
    for asked, least in (("1", 1.0), ("date", 1.0), ("soon", 0.05)):
        # Such a date has no fractions of a second: three seconds ahead are more than two.
        said = formatdate(time.time() + 3, usegmt=True) if asked == "date" else asked
        with scripted((status, headers | {"retry-after": said}, body), good) as (url, received), Client(url) as client:
            began = time.monotonic()
            assert client.detect(data / "chair.obj").point_group == "Cs"
            assert time.monotonic() - began >= least
            # The file was read anew for the second try.
            assert len(received) == 2
            assert received[0] == received[1] > (data / "chair.obj").stat().st_size


def test_retries_end(data: Path) -> None:
    with scripted(problem(503, "overloaded")) as (url, received):
        with Client(url, retries=2) as client, pytest.raises(UnavailableError, match=r"D\."):
            client.detect(data / "chair.obj")
        assert len(received) == 3
    with scripted(problem(500, "internal-error")) as (url, received):
        with Client(url) as client, pytest.raises(UnavailableError):
            client.detect(data / "chair.obj")
        assert len(received) == 1  # a defect stays one


@pytest.mark.parametrize(
    "answer",
    [(200, {}, b"<html>"), (404, {"content-type": "text/html"}, b"no"), (302, {"location": "/"}, b"")],
)
def test_what_is_not_the_service_is_said_to_be_none(data: Path, answer: Any) -> None:
    with scripted(answer) as (url, _), Client(url, retries=0) as client:
        with pytest.raises(UnexpectedAnswerError):
            client.detect(data / "chair.obj")
        with pytest.raises(UnexpectedAnswerError):
            client.complete(data / "chair.obj")


def test_no_connection_and_no_answer(data: Path) -> None:
    with Client("http://127.0.0.1:9", retries=1) as nobody, pytest.raises(UnreachableError):
        nobody.detect(data / "chair.obj")
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        url = f"http://127.0.0.1:{silent.getsockname()[1]}"
        began = time.monotonic()
        with Client(url, timeout=0.3) as client, pytest.raises(UnreachableError):
            client.detect(data / "chair.obj")
        assert time.monotonic() - began < 5  # it was tried once: what was slow once is slow again

    async def nobody_there() -> None:
        async with AsyncClient("http://127.0.0.1:9", retries=0) as client:
            assert not await client.ready()
            await client.detect(data / "chair.obj")

    with pytest.raises(UnreachableError):
        asyncio.run(nobody_there())


def test_a_file_is_streamed_from_disk(tmp_path: Path) -> None:
    """300 MB go over the wire, and the client's memory does not grow by as much."""
    path = tmp_path / "large.stl"
    with path.open("wb") as file:
        file.truncate(300 << 20)
    script = (
        "import resource, sys; from app import Client, ClientError\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "with Client(sys.argv[1]) as client:\n"
        "    try:\n        client.detect(sys.argv[2])\n    except ClientError as error:\n        print(error)\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)\n"
    )
    with scripted(problem(413, "upload-too-large")) as (url, received):
        command = [sys.executable, "-c", script, url, str(path)]
        result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=True)
    message, grown = result.stdout.split("\n")[:2]
    assert message == "D."
    assert received[0] > 300 << 20
    assert int(grown) < 100 * 1024  # KiB


def test_public_names_are_what_all_says() -> None:
    assert sorted(app.__all__) == app.__all__
    assert set(app.__all__) == set(app._HOMES)
    for name in app.__all__:
        value = getattr(app, name)
        assert value.__module__.startswith("app.")
        assert value.__doc__
    with pytest.raises(AttributeError, match="no attribute 'Detector'"):
        _ = app.Detector
    assert not {"numba", "torch", "fastapi"} & set(
        subprocess.run(
            [sys.executable, "-c", "import sys; from app import Client; print(*sys.modules)"],
            cwd=ROOT, capture_output=True, text=True, check=True,
        ).stdout.split()
    )  # fmt: skip


def test_httpx_stays_behind_the_client() -> None:
    assert issubclass(httpx.ConnectError, httpx.TransportError)  # all of them become UnreachableError
    with pytest.raises(ValueError, match="retries"):
        Client(retries=-1)
