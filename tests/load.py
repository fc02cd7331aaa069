"""Clients that load, probe and disturb a running server, and count what came of it."""

import asyncio
import http.client
import json
import os
import random
import signal
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

BOUNDARY = "load-5c1b0f"


def form(name: str, content: bytes) -> bytes:
    """A multipart body with one file."""
    head = f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="file"; filename="{name}"\r\n\r\n'
    return head.encode() + content + f"\r\n--{BOUNDARY}--\r\n".encode()


def head(length: int, path: str = "/detect") -> bytes:
    """The header of a request for a body of ``length`` bytes."""
    lines = [f"POST {path} HTTP/1.1", "Host: t", f"Content-Type: multipart/form-data; boundary={BOUNDARY}"]
    return "\r\n".join([*lines, f"Content-Length: {length}", "", ""]).encode()


@dataclass
class Tally:
    """What clients saw. ``sent`` and the sum of ``statuses`` and ``broken`` must agree."""

    sent: int = 0
    statuses: Counter[str] = field(default_factory=Counter[str])
    seconds: list[float] = field(default_factory=list[float])
    wrong: list[str] = field(default_factory=list[str])
    broken: Counter[str] = field(default_factory=Counter[str])
    lock: threading.Lock = field(default_factory=threading.Lock)


def post(port: int, body: bytes, timeout: float = 60.0) -> tuple[int, dict[str, Any]]:
    """Status and JSON of one request over a connection of its own."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=timeout)
    try:
        headers = {"Content-Type": f"multipart/form-data; boundary={BOUNDARY}", "Connection": "close"}
        connection.request("POST", "/detect", body, headers)
        response = connection.getresponse()
        return response.status, json.loads(response.read())
    finally:
        connection.close()


def count(port: int, body: bytes, tally: Tally, right: Callable[[dict[str, Any]], bool]) -> None:
    """Send one request and note its outcome; ``right`` judges an answer of 200."""
    with tally.lock:
        tally.sent += 1
    began = time.perf_counter()
    try:
        status, answer = post(port, body)
    except (OSError, http.client.HTTPException, ValueError) as error:
        with tally.lock:
            tally.broken[type(error).__name__] += 1
        return
    with tally.lock:
        tally.seconds.append(time.perf_counter() - began)
        kind = "" if status == 200 else " " + str(answer.get("type", "")).rsplit("/", 1)[-1]
        tally.statuses[f"{status}{kind}"] += 1
        if status == 200 and not right(answer):
            tally.wrong.append(json.dumps(answer)[:300])


class Background(threading.Thread):
    """Repeats something until it is told to stop, at a rate if one is given."""

    def __init__(self, action: Callable[[], None], pause: float = 0.0) -> None:
        super().__init__(daemon=True)
        self._action, self._pause = action, pause
        self._stop_now = threading.Event()
        self.start()

    def run(self) -> None:
        due = time.monotonic()
        while not self._stop_now.is_set():
            self._action()
            due = max(due + self._pause, time.monotonic() - self._pause)
            self._stop_now.wait(max(due - time.monotonic(), 0.0))

    def stop(self) -> None:
        self._stop_now.set()
        self.join(90)
        assert not self.is_alive()


def probe(port: int, path: str, seconds: list[float], statuses: Counter[int]) -> None:
    """One GET, timed."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    try:
        began = time.perf_counter()
        connection.request("GET", path)
        response = connection.getresponse()
        response.read()
        seconds.append(time.perf_counter() - began)
        statuses[response.status] += 1
    finally:
        connection.close()


def hang_up(port: int, body: bytes, chance: random.Random) -> None:
    """Leave somewhere between the first byte of a request and its answer."""
    whole = head(len(body)) + body
    with socket.create_connection(("127.0.0.1", port), timeout=30) as connection:
        connection.sendall(whole[: chance.choice([1, 40, len(whole) // 2, len(whole) - 1, len(whole)])])
        time.sleep(chance.choice([0.0, 0.01, 0.05]))


def processes(parent: int) -> dict[int, int]:
    """All descendants of a process: id -> parent's id."""
    parents: dict[int, int] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parents[int(entry.name)] = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
            except (OSError, IndexError):
                continue
    found: dict[int, int] = {}
    waiting = [parent]
    while waiting:
        one = waiting.pop()
        for child in (child for child, above in parents.items() if above == one):
            found[child] = one
            waiting.append(child)
    return found


def zygote_of(server: int) -> int:
    """The process that workers are forked from."""
    (zygote,) = (child for child, above in processes(server).items() if above == server)
    return zygote


def workers_of(server: int) -> list[int]:
    """The worker processes."""
    return [child for child, above in processes(server).items() if above != server]


def kill_one(server: int, chance: random.Random, killed: list[int]) -> None:
    """SIGKILL for one worker, whatever it is doing."""
    if workers := workers_of(server):
        victim = chance.choice(sorted(workers))
        try:
            os.kill(victim, signal.SIGKILL)
            killed.append(victim)
        except ProcessLookupError:
            pass


def resident_kb(server: int) -> int:
    """Memory of the server and all its processes, shared pages counted once (the sum of their proportional shares)."""
    total = 0
    for pid in (server, *processes(server)):
        try:
            rollup = Path(f"/proc/{pid}/smaps_rollup").read_text()
        except OSError:
            continue
        total += sum(int(line.split()[1]) for line in rollup.splitlines() if line.startswith("Pss:"))
    return total


@dataclass
class Flood:
    """What an open load saw: requests sent at a rate whether or not answers come, each over its own connection."""

    sent: int = 0
    statuses: Counter[int] = field(default_factory=Counter[int])
    seconds: list[float] = field(default_factory=list[float])
    """Of the answers with 200."""

    wrong: int = 0


class _Sender(asyncio.Protocol):
    """Sends one request and reads its answer; as little work as can be, for many of them."""

    def __init__(self, request: bytes, sign: bytes, flood: Flood) -> None:
        self._request, self._sign, self._flood = request, sign, flood
        self._began = time.perf_counter()
        self._answer = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        transport.write(self._request)  # type: ignore[attr-defined]

    def data_received(self, data: bytes) -> None:
        self._answer += data

    def connection_lost(self, error: Exception | None) -> None:
        status = int(self._answer[9:12]) if self._answer else 0
        self._flood.statuses[status] += 1
        if status == 200:
            self._flood.seconds.append(time.perf_counter() - self._began)
            self._flood.wrong += self._sign not in self._answer


def flood(port: int, request: bytes, sign: bytes, rate: float, seconds: float) -> Flood:
    """Offer a request, whose header says ``Connection: close``, at a rate; answers of 200 hold ``sign``."""
    result = Flood()

    async def run() -> None:
        loop = asyncio.get_running_loop()
        began = loop.time()
        tasks: set[asyncio.Task[Any]] = set()
        while (now := loop.time()) < began + seconds:
            while result.sent < (now - began) * rate:
                result.sent += 1
                task = loop.create_task(
                    loop.create_connection(lambda: _Sender(request, sign, result), "127.0.0.1", port)
                )
                tasks.add(task)
                task.add_done_callback(tasks.discard)
            await asyncio.sleep(0.002)
        end = loop.time() + 60
        while sum(result.statuses.values()) < result.sent and loop.time() < end:
            await asyncio.sleep(0.05)

    asyncio.run(run())
    return result
