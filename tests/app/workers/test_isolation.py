"""What a worker can know of others: no secrets, no other tenant; what is stopped, hangs or crashed is replaced."""

import asyncio
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from app.settings import Settings
from app.workers import sandbox, zygote_client
from app.workers.pool import WorkerPool
from app.workers.wire import SandboxLimits
from app.workers.zygote_client import StartError, ZygoteClient
from tests.app.fakes import FakeDetector, Serving, forked
from tests.app.http.test_capacity import alive, until

pytestmark = pytest.mark.anyio


async def test_the_process_that_workers_are_forked_from_knows_no_secret(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PRSNET_API_KEYS", "secret-a,secret-b")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret-c")
    monkeypatch.setenv("LC_ALL", "C.UTF-8")
    connection, end = zygote_client.launcher("no-such.safetensors")(SandboxLimits(1 << 30, True, 0))
    try:
        child = int(Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text().split()[-1])
        environment = Path(f"/proc/{child}/environ")
        await until(lambda: environment.read_bytes() != b"")  # it has none while it becomes another program
        known = environment.read_bytes().split(b"\0")
    finally:
        connection.close()
        end()
    assert b"LC_ALL=C.UTF-8" in known
    assert not any(b"secret" in entry or entry.startswith(b"PRSNET_") for entry in known)


@pytest.mark.parametrize("isolation", ["none", "client", "request"])
async def test_no_worker_serves_two_keys_unless_it_may(
    serving: Serving, detector: FakeDetector, chair: bytes, isolation: str
) -> None:
    keys = ["ann", "ann", "bob", "bob", "ann", "cid", "dan", "dan", "eve", "ann"]
    async with serving(detector, api_keys="ann,bob,cid,dan,eve", isolation=isolation) as (client, runtime):
        for key in keys:
            files = {"file": ("chair.obj", chair)}
            assert (await client.post("/detect", files=files, headers={"X-API-Key": key})).status_code == 200
        used = [call["pid"] for call in detector.calls]
        await until(lambda: runtime.pool.live == 2)
    served = {pid: {key for key, other in zip(keys, used, strict=True) if other == pid} for pid in used}
    if isolation == "none":
        assert len(served) == 1
        return
    assert all(len(known) == 1 for known in served.values())
    if isolation == "client":
        assert used[0] == used[1]
        assert used[2] == used[3]
        assert used[6] == used[7]
    else:
        assert len(served) == len(keys)


async def test_clients_without_keys_are_told_apart_by_their_addresses(
    serving: Serving, detector: FakeDetector, chair: bytes
) -> None:
    async with serving(detector, workers=2, client_address_header="X-Forwarded-For") as (client, _):
        for address in ("10.0.0.1", "10.0.0.2", "10.0.0.1", "10.0.0.2"):
            files = {"file": ("chair.obj", chair)}
            response = await client.post("/detect", files=files, headers={"X-Forwarded-For": f"1.1.1.1, {address}"})
            assert response.status_code == 200
        used = [call["pid"] for call in detector.calls]
    assert used[0] == used[2] != used[1] == used[3]


async def test_a_stopped_idle_worker_is_replaced(serving: Serving, detector: FakeDetector, chair: bytes) -> None:
    async with serving(detector, workers=1) as (client, runtime):
        stopped = [worker.pid for worker in runtime.pool._idle]
        for pid in stopped:
            os.kill(pid, signal.SIGSTOP)
        response = await client.post("/detect", files={"file": ("chair.obj", chair)})
        assert response.status_code == 200
        await until(lambda: not any(alive(pid) for pid in stopped))
        await until(lambda: runtime.pool.live == 2)


async def test_a_worker_stopped_at_work_is_replaced_and_its_job_tried_again(
    serving: Serving, detector: FakeDetector, chair: bytes
) -> None:
    detector.gate.clear()
    async with serving(detector, workers=1) as (client, runtime):
        reasons: list[str] = []
        runtime.pool.on_restart = reasons.append
        answer = asyncio.create_task(client.post("/detect", files={"file": ("chair.obj", chair)}))
        await until(lambda: len(detector.calls) == 1)
        os.kill(detector.calls[0]["pid"], signal.SIGSTOP)
        await until(lambda: len(detector.calls) == 2)
        detector.gate.set()
        assert (await answer).status_code == 200
        assert reasons == ["lost"]
        assert not alive(detector.calls[0]["pid"])


async def test_a_fork_that_hangs_is_given_up(monkeypatch: pytest.MonkeyPatch, detector: FakeDetector) -> None:
    monkeypatch.setattr(zygote_client, "_FORK_S", 0.3)
    pids = list[int]()
    launch = forked(detector)

    def noted(limits: SandboxLimits) -> Any:
        before = set(_children())
        result = launch(limits)
        pids.extend(set(_children()) - before)
        return result

    client = ZygoteClient(noted, SandboxLimits(1 << 30, sandbox.available(), 0))
    await client.start()
    os.kill(pids[0], signal.SIGSTOP)
    asyncio.get_running_loop().call_later(1.0, os.kill, pids[0], signal.SIGCONT)  # `forked` waits for its end
    with pytest.raises(TimeoutError):
        await client.spawn()
    assert not client.alive


def _children() -> list[int]:
    return list(map(int, Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text().split()))


async def test_after_a_crash_workers_come_from_a_new_process(
    serving: Serving, detector: FakeDetector, chair: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.workers.pool._RENEW_S", 1.0)
    async with serving(detector, workers=1) as (client, runtime):
        pool = runtime.pool
        former = pool._zygotes.current
        pool._renew()
        await until(lambda: pool._zygotes.current is not former and pool.live == 2)
        again = pool._zygotes.current
        pool._renew()  # a while later, for they are not made all the time
        pool._renew()
        await asyncio.sleep(0.1)
        assert pool._zygotes.current is again
        await until(lambda: pool._zygotes.current is not again and pool.live == 2)
        assert (await client.post("/detect", files={"file": ("chair.obj", chair)})).status_code == 200


async def test_now_and_then_workers_come_from_a_new_process_and_nobody_notices(
    serving: Serving, detector: FakeDetector, chair: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.workers.pool._WATCH_S", 0.02)
    files = {"file": ("chair.obj", chair)}
    reasons = list[str]()
    async with serving(detector, workers=1, renew_s=0.2, api_keys="ann,bob") as (client, runtime):
        pool = runtime.pool

        async def ask(key: str) -> int:
            return (await client.post("/detect", files=files, headers={"X-API-Key": key})).status_code

        await asyncio.sleep(0.5)
        first, children = pool._zygotes.current, _children()
        assert reasons == []  # as long as nobody's worker was replaced there is nothing to hide
        pool.on_restart = reasons.append
        assert [await ask("ann"), await ask("bob")] == [200, 200]  # one was replaced for another client's sake
        detector.gate.clear()
        working = asyncio.create_task(ask("ann"))
        await until(lambda: len(detector.calls) == 3 and pool._zygotes.current is not first)
        monkeypatch.setattr("app.workers.zygotes.Zygotes.is_aged", False)  # once will do
        detector.gate.set()
        assert await working == 200
        assert len(detector.calls) == 3  # nothing was tried a second time
        await until(lambda: not pool._retiring and pool.live == 2)
        assert set(reasons) == {"client", "aged"}
        assert len(_children()) == len(children)
        assert {worker.origin for worker in pool._live} == {pool._zygotes.current}
        assert await ask("bob") == 200


async def test_while_a_new_process_loads_the_old_one_goes_on_forking(
    serving: Serving, detector: FakeDetector, chair: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    loading, loaded = asyncio.Event(), asyncio.Event()
    async with serving(detector, workers=1, isolation="request") as (client, runtime):
        start = ZygoteClient.start

        async def slow(self: ZygoteClient) -> Any:
            loading.set()
            await loaded.wait()
            return await start(self)

        monkeypatch.setattr(ZygoteClient, "start", slow)
        exchange = asyncio.create_task(runtime.pool._exchange_zygote())
        await loading.wait()
        for _ in range(4):  # more than there are spare workers
            assert (await client.post("/detect", files={"file": ("chair.obj", chair)})).status_code == 200
        loaded.set()
        await exchange


async def test_without_a_filter_for_system_calls_it_does_not_start(
    monkeypatch: pytest.MonkeyPatch, detector: FakeDetector, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("platform.machine", lambda: "i686")
    pool = WorkerPool(Settings(workers=1), forked(detector))
    with pytest.raises(StartError, match="PRSNET_SANDBOX=false"):
        await pool.start()
    pool = WorkerPool(Settings(workers=1, sandbox=False), forked(detector))
    await pool.start()
    await pool.close()
    assert "PRSNET_SANDBOX=false" in caplog.text


async def test_without_proc_limits_are_not_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*_: Any) -> Any:
        raise FileNotFoundError

    monkeypatch.setattr(sandbox, "_address_space", missing)
    monkeypatch.setattr(sandbox, "_set", lambda *_: None)
    with pytest.raises(FileNotFoundError):
        sandbox.limit_resources(1 << 30, strict=True)
    sandbox.limit_resources(1 << 30)


async def test_where_a_worker_cannot_be_locked_in_the_service_does_not_start(
    monkeypatch: pytest.MonkeyPatch, detector: FakeDetector
) -> None:
    def missing(*_: Any) -> Any:
        raise FileNotFoundError(2, "No such file or directory", "/proc/self/statm")

    monkeypatch.setattr(sandbox, "_address_space", missing)  # the processes are forked from this one
    pool = WorkerPool(Settings(workers=1), forked(detector))
    with pytest.raises(StartError, match=r"(?s)^a worker cannot be locked in here.*/proc.*PRSNET_SANDBOX=false"):
        await pool.start()
    await pool.close()
    pool = WorkerPool(Settings(workers=1, sandbox=False), forked(detector))
    await pool.start()
    await pool.close()


@pytest.mark.skipif(not sandbox.available(), reason="needs Linux on x86-64 or ARM64")
async def test_work_that_the_sandbox_breaks_is_found_at_the_start(
    monkeypatch: pytest.MonkeyPatch, detector: FakeDetector
) -> None:
    monkeypatch.setattr("app.workers.worker.parse_and_detect", lambda *_: Path("/etc/passwd").read_text())
    pool = WorkerPool(Settings(workers=1), forked(detector))
    with pytest.raises(StartError, match="PermissionError"):
        await pool.start()
    await pool.close()
