"""Overload, deadline and leaving clients: what is refused, dropped, and when a place is free again."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from app.workers.wire import Job
from tests.app.fakes import FakeDetector, Serving

pytestmark = pytest.mark.anyio


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(20):
        while not condition():
            await asyncio.sleep(0.005)


def alive(pid: int) -> bool:
    """Whether a process of this id runs; one that ended and waits to be reaped does not."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


async def test_requests_beyond_workers_and_queue_are_refused_at_once(
    serving: Serving, detector: FakeDetector, chair: bytes, assert_problem: Any
) -> None:
    files = {"file": ("chair.obj", chair)}
    detector.gate.clear()
    async with serving(detector, workers=1, queue=2) as (client, runtime):
        waiting = [asyncio.create_task(client.post("/detect", files=files)) for _ in range(3)]
        await until(lambda: runtime.pool.admitted == 3)
        refused = await client.post("/detect", files=files)
        assert_problem(refused, "overloaded", 503)
        assert int(refused.headers["retry-after"]) >= 1
        assert (await client.get("/health")).status_code == 200
        detector.gate.set()
        assert [(await task).status_code for task in waiting] == [200, 200, 200]
        await until(lambda: runtime.pool.admitted == 0)
        assert (await client.post("/detect", files=files)).status_code == 200


async def test_deadline_ends_the_work_and_frees_its_worker(
    serving: Serving, detector: FakeDetector, chair: bytes, assert_problem: Any
) -> None:
    files = {"file": ("chair.obj", chair)}
    detector.gate.clear()
    lost: list[str] = []
    async with serving(detector, workers=1, queue=1, deadline_s=1.0) as (client, runtime):
        runtime.pool.on_restart = lost.append
        first, second = await asyncio.gather(*[client.post("/detect", files=files) for _ in range(2)])
        for response in (first, second):
            assert_problem(response, "deadline-passed", 504)
        assert runtime.pool.admitted == 0
        # The one that waited had the worker for a moment if its deadline came a little later.
        assert set(lost) == {"deadline"}
        await until(lambda: not alive(detector.calls[0]["pid"]))
        detector.gate.set()  # only now could that work have ended by itself
        assert (await client.post("/detect", files=files)).status_code == 200
        assert detector.calls[-1]["pid"] != detector.calls[0]["pid"]


def endless() -> None:
    """Uses up processor time."""
    while True:
        pass


async def test_work_is_bounded_even_where_the_server_does_not_end_it(
    serving: Serving, detector: FakeDetector, chair: bytes, assert_problem: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    detector.action = endless
    async with serving(detector, workers=1, deadline_s=240.0) as (client, runtime):
        monkeypatch.setattr("app.http.handler.Job", lambda **members: Job(**(members | {"cpu_s": 0.0})))
        response = await client.post("/detect", files={"file": ("chair.obj", chair)})
        document = assert_problem(response, "deadline-passed", 504)
        assert "processor time" in document["detail"]
        await until(lambda: runtime.pool.live == 2)


async def test_deadline_covers_the_upload(serving: Serving, detector: FakeDetector, assert_problem: Any) -> None:
    async def trickle() -> Any:
        yield b"--b\r\n"
        await asyncio.sleep(20)

    headers = {"content-type": "multipart/form-data; boundary=b"}
    async with serving(detector, deadline_s=0.2) as (client, runtime):
        response = await client.post("/detect", content=trickle(), headers=headers)
        assert_problem(response, "deadline-passed", 504)
        assert runtime.pool.admitted == 0


@pytest.mark.parametrize("place", ["running", "waiting"])
async def test_work_of_a_client_that_left_is_dropped(
    serving: Serving, detector: FakeDetector, chair: bytes, place: str
) -> None:
    """The request is made by hand, because httpx's in-memory transport cannot hang up."""
    body = b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.obj"\r\n\r\n' + chair + b"\r\n--b--\r\n"
    scope = {
        "type": "http", "http_version": "1.1", "method": "POST", "path": "/detect", "raw_path": b"/detect",
        "query_string": b"", "root_path": "", "scheme": "http", "server": ("t", 80), "client": ("t", 1),
        "headers": [(b"content-type", b"multipart/form-data; boundary=b")],
    }  # fmt: skip
    detector.gate.clear()
    before = place == "waiting"  # whether another request has the only worker
    lost: list[str] = []
    async with serving(detector, workers=1, queue=1) as (client, runtime):
        runtime.pool.on_restart = lost.append
        if before:
            running = asyncio.create_task(client.post("/detect", files={"file": ("chair.obj", chair)}))
            await until(lambda: len(detector.calls) == 1)
        messages = [{"type": "http.request", "body": body}]

        async def receive() -> Any:
            if not messages:
                await until(lambda: runtime.pool.admitted == 1 + before and len(detector.calls) == 1)
                return {"type": "http.disconnect"}
            return messages.pop(0)

        async def send(_: Any) -> None:
            pass

        await client._transport.app(scope, receive, send)  # type: ignore[attr-defined]
        assert runtime.pool.admitted == before
        await until(lambda: alive(detector.calls[0]["pid"]) == before)  # work that ran was ended
        assert lost == ([] if before else ["client-left"])
        detector.gate.set()
        if before:
            assert (await running).status_code == 200
        assert (await client.post("/detect", files={"file": ("chair.obj", chair)})).status_code == 200
        assert len(detector.calls) == 2


async def test_refused_uploads_give_their_place_back(serving: Serving, detector: FakeDetector, chair: bytes) -> None:
    async with serving(detector, workers=1, queue=0, max_upload_bytes=2048) as (client, runtime):
        for _ in range(3):
            assert (await client.post("/detect", files={"file": ("chair.obj", chair)})).status_code == 413
            assert (await client.post("/detect", content=b"x")).status_code == 400
        assert runtime.pool.admitted == 0


async def test_every_route_that_makes_work_is_refused_before_a_request_is_made_of_it(
    serving: Serving, detector: FakeDetector
) -> None:
    async with serving(detector) as (client, runtime):
        schema = (await client.get("/openapi.json")).json()
        work = [path for path, methods in schema["paths"].items() if "post" in methods]
        assert {"/detect", "/complete"} < set(work)
        for path in work:
            assert runtime.gate.guards(b"POST", path.encode()), path
            await client.post(path)
            assert f'route="{path}"' in (await client.get("/metrics")).text


async def test_a_client_that_sends_all_it_can_keeps_no_other_out(
    serving: Serving, detector: FakeDetector, chair: bytes
) -> None:
    """Another's first request finds a place, and is worked on before the second of the one that waits."""
    files = {"file": ("chair.obj", chair)}
    detector.gate.clear()
    done: list[str] = []
    async with serving(detector, workers=1, queue=7, api_keys="greedy,modest") as (client, runtime):

        async def ask(key: str) -> int:
            status = (await client.post("/detect", files=files, headers={"X-API-Key": key})).status_code
            done.append(f"{key} {status}")
            return status

        crowd = [asyncio.create_task(ask("greedy")) for _ in range(8)]
        await until(lambda: runtime.pool.admitted + len(done) == 8)
        assert done == ["greedy 503"] * 2
        one = asyncio.create_task(ask("modest"))
        await until(lambda: runtime.pool.admitted == 7)
        detector.gate.set()
        assert await one == 200
        assert done.count("greedy 200") <= 2  # the one that was worked on, and the next in turn
        assert [await task for task in crowd].count(200) == 6
        assert runtime.pool.admitted == 0
