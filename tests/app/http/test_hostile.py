"""Hostile files through the service: every one gets a clear answer, and costs no worker but perhaps its own."""

import contextlib
import ctypes
import errno
import fcntl
import mmap
import os
import platform
import resource
import struct
import time
from typing import Any

import pytest

from app.workers import sandbox
from tests.app.fakes import FakeDetector, Serving
from tests.hostile import CLASSES

pytestmark = pytest.mark.anyio
REFUSED = {400, 413, 415, 422}


@pytest.mark.parametrize("kind", CLASSES)
async def test_every_hostile_file_gets_a_clear_answer(
    serving: Serving, detector: FakeDetector, assert_problem: Any, kind: str
) -> None:
    lost: list[str] = []
    async with serving(detector, workers=2, worker_memory_bytes=256 << 20) as (client, runtime):
        runtime.pool.on_restart = lost.append
        for name, data in CLASSES[kind](0.1):
            response = await client.post("/detect?include=rejected", files={"file": (name, data)})
            if response.status_code != 200:
                assert response.status_code in REFUSED, (name, response.text)
                document = assert_problem(
                    response, response.json()["type"].removeprefix("/problems/"), response.status_code
                )
                assert "passwd" not in document["detail"]
            else:
                kept = response.json()["mesh"]["filename"]
                assert kept.isprintable()
                assert not set("/\\") & set(kept)
                assert len(kept) <= 255
        assert set(lost) <= {"memory"}


async def test_memory_is_bounded_and_the_worker_replaced(
    serving: Serving, detector: FakeDetector, chair: bytes, assert_problem: Any
) -> None:
    # As Python objects, thirty times its size.
    text = b'{"asset": {"version": "2.0"}, "extras": [' + b"{}," * 12_000_000 + b"{}]}"
    lost: list[str] = []
    async with serving(detector, worker_memory_bytes=256 << 20) as (client, runtime):
        runtime.pool.on_restart = lost.append
        response = await client.post("/detect", files={"file": ("a.gltf", text)})
        assert "memory" in assert_problem(response, "mesh-too-large", 413)["detail"]
        assert lost == ["memory"]
        assert (await client.post("/detect", files={"file": ("chair.obj", chair)})).status_code == 200


async def test_reading_has_a_time_limit_of_its_own(
    serving: Serving, detector: FakeDetector, assert_problem: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slow(*_: Any, **__: Any) -> Any:
        time.sleep(60)

    # The zygote is forked after the patch. What workers warm up with is called elsewhere.
    monkeypatch.setattr("app.workers.worker.perform", slow)
    async with serving(detector, parse_s=0.3) as (client, _):
        document = assert_problem(await client.post("/detect", files={"file": ("b.obj", b"v")}), "deadline-passed", 504)
        assert "Reading" in document["detail"]


def read_a_secret() -> None:
    with open("/etc/passwd") as file:
        raise RuntimeError("leaked: " + file.read())


def connect() -> None:
    import socket

    socket.create_connection(("127.0.0.1", 9), timeout=1)


def run_a_program() -> None:
    os.execv("/bin/true", ["true"])


def fork() -> None:
    os.fork()


def write_a_file() -> None:
    with open("/tmp/prsnet-was-here", "w"):
        raise RuntimeError("leaked")


def signal_the_server() -> None:
    os.kill(os.getppid(), 0)
    raise RuntimeError("leaked")


def have_the_server_sent_signals() -> None:
    fcntl.fcntl(_socket(), 8, os.getppid())  # F_SETOWN
    raise RuntimeError("leaked")


def choose_the_signal() -> None:
    fcntl.fcntl(_socket(), 10, 9)  # F_SETSIG
    raise RuntimeError("leaked")


def own_with_a_struct() -> None:
    fcntl.fcntl(_socket(), 15, struct.pack("ii", 1, os.getppid()))  # F_SETOWN_EX
    raise RuntimeError("leaked")


def ask_for_signals() -> None:
    flags = fcntl.fcntl(_socket(), fcntl.F_GETFL)
    fcntl.fcntl(_socket(), fcntl.F_SETFL, flags | os.O_NONBLOCK)  # this is allowed
    fcntl.fcntl(_socket(), fcntl.F_SETFL, flags)
    fcntl.fcntl(_socket(), fcntl.F_SETFL, flags | 0x2000)  # O_ASYNC
    raise RuntimeError("leaked")


def ask_for_signals_by_ioctl() -> None:
    fcntl.ioctl(_socket(), 0x8902, struct.pack("i", os.getppid()))  # SIOCSPGRP
    raise RuntimeError("leaked")


def read_the_servers_memory() -> None:
    with open(f"/proc/{os.getppid()}/mem", "rb"):
        raise RuntimeError("leaked")


def see_what_cores_the_server_has() -> None:
    os.sched_getaffinity(os.getppid())
    raise RuntimeError("leaked")


def limit_the_server() -> None:
    resource.prlimit(os.getppid(), resource.RLIMIT_CPU)
    raise RuntimeError("leaked")


def raise_its_memory() -> None:
    memory = resource.getrlimit(resource.RLIMIT_AS)  # this is allowed
    with contextlib.suppress(ValueError):  # Python's word for EPERM
        resource.setrlimit(resource.RLIMIT_AS, (memory[0] + 1, memory[1] + 1))
        raise RuntimeError("leaked")
    raise PermissionError


def write_files_again() -> None:
    with contextlib.suppress(ValueError):
        resource.setrlimit(resource.RLIMIT_FSIZE, (1, 1))
        raise RuntimeError("leaked")
    raise PermissionError


def spoil_memory_that_others_share() -> None:
    with mmap.mmap(-1, mmap.PAGESIZE) as area:
        area.madvise(mmap.MADV_DONTNEED)  # this is allowed
        libc, address = ctypes.CDLL(None, use_errno=True), ctypes.addressof(ctypes.c_char.from_buffer(area))
        for advice in (100, 101, 12):  # HWPOISON, SOFT_OFFLINE, MERGEABLE
            assert libc.madvise(ctypes.c_void_p(address), mmap.PAGESIZE, advice) == -1, "leaked"
            assert ctypes.get_errno() == errno.EPERM, "leaked"
    raise PermissionError


def call_whatever_is_not_on_the_list() -> None:
    column = sandbox._ARCHITECTURES[platform.machine()][0]
    tables = (sandbox._ALWAYS, sandbox._ON_ITSELF, sandbox._FCNTL, sandbox._MADVISE, sandbox._LIMITS)
    listed = {number for table in tables for number in sandbox._numbers(table, column)}
    libc = ctypes.CDLL(None, use_errno=True)
    probes = {335, 336} if column == 0 else set[int]()  # the kernel asks no filter, and ends who calls them like this
    for number in sorted(set(range(1024)) - listed - probes):
        for upper in (0, 0x40000000):  # the calls of x32
            assert libc.syscall(number | upper, -1, 0, 0, 0, 0, 0) == -1, f"leaked: {number}"
            assert ctypes.get_errno() == errno.EPERM, f"leaked: {number}"
    raise PermissionError


def _socket() -> int:
    """What the worker has open beside the standard streams: its end of the socket to the server is among it."""
    for descriptor in range(3, 4096):
        with contextlib.suppress(OSError):
            fcntl.fcntl(descriptor, fcntl.F_GETFD)
            return descriptor
    raise AssertionError


ESCAPES = [
    read_a_secret, connect, run_a_program, fork, write_a_file, signal_the_server, have_the_server_sent_signals,
    choose_the_signal, own_with_a_struct, ask_for_signals, ask_for_signals_by_ioctl, read_the_servers_memory,
    see_what_cores_the_server_has, limit_the_server, raise_its_memory, write_files_again,
    spoil_memory_that_others_share, call_whatever_is_not_on_the_list,
]  # fmt: skip


@pytest.mark.skipif(not sandbox.available(), reason="needs Linux on x86-64 or ARM64")
@pytest.mark.parametrize("action", ESCAPES)
async def test_a_worker_that_was_taken_over_is_locked_in(
    serving: Serving,
    detector: FakeDetector,
    chair: bytes,
    assert_problem: Any,
    caplog: pytest.LogCaptureFixture,
    action: Any,
) -> None:
    detector.action = action
    async with serving(detector) as (client, _):
        response = await client.post("/detect", files={"file": ("chair.obj", chair)})
        assert_problem(response, "internal-error", 500)
    assert "leaked" not in caplog.text
    assert "PermissionError" in caplog.text
