"""Starting, failing to start, draining."""

import asyncio
from typing import Any

import pytest

from app.http.runtime import State
from model.errors import CheckpointError
from tests.app.fakes import FakeDetector, Serving

pytestmark = pytest.mark.anyio


async def test_not_ready_before_the_detector_is_warm(
    serving: Serving, detector: FakeDetector, chair: bytes, assert_problem: Any
) -> None:
    detector.warm_gate.clear()
    async with serving(detector, wait=False) as (client, runtime):
        assert (await client.get("/health/live")).json() == {"status": "alive"}
        for response in (
            await client.get("/health"),
            await client.get("/model"),
            await client.post("/detect", files={"file": ("chair.obj", chair)}),
        ):
            document = assert_problem(response, "not-ready", 503)
            assert "starting" in document["detail"]
            assert response.headers["retry-after"]
        detector.warm_gate.set()
        while runtime.state is State.STARTING:
            await asyncio.sleep(0.005)
        assert (await client.get("/health")).json() == {"status": "ready"}


async def test_failed_start_is_reported_and_never_ready(
    serving: Serving, detector: FakeDetector, assert_problem: Any, caplog: pytest.LogCaptureFixture
) -> None:
    detector.warm_failure = CheckpointError("The weights do not fit.")
    detector.warm_gate.clear()
    told: list[bool] = []
    async with serving(detector, wait=False) as (client, runtime):
        runtime.on_failure = lambda: told.append(True)
        detector.warm_gate.set()
        while not told:
            await asyncio.sleep(0.005)
        assert_problem(await client.get("/health"), "not-ready", 503)
        assert (await client.get("/health/live")).status_code == 200
    assert "The weights do not fit." in caplog.text


async def test_draining_turns_new_traffic_away_but_serves_what_comes(
    serving: Serving, detector: FakeDetector, chair: bytes, assert_problem: Any
) -> None:
    async with serving(detector) as (client, runtime):
        runtime.drain()
        assert "shutting down" in assert_problem(await client.get("/health"), "not-ready", 503)["detail"]
        assert (await client.post("/detect", files={"file": ("chair.obj", chair)})).status_code == 200
        assert (await client.get("/health/live")).status_code == 200


async def test_stop_waits_for_running_work(serving: Serving, detector: FakeDetector, chair: bytes) -> None:
    detector.gate.clear()
    async with serving(detector) as (client, runtime):
        running = asyncio.create_task(client.post("/detect", files={"file": ("chair.obj", chair)}))
        while not detector.calls:
            await asyncio.sleep(0.005)
        stopping = asyncio.create_task(runtime.stop())
        await asyncio.sleep(0.1)
        assert not stopping.done()
        detector.gate.set()
        await stopping
        assert (await running).status_code == 200
        assert runtime.pool.live == 0
