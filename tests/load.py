"""Clients that load, probe and disturb a running server, and count what came of it."""

import http.client
import json
import os
import random
import select
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
    """What a load of requests saw, each over its own connection."""

    sent: int = 0
    statuses: Counter[int] = field(default_factory=Counter[int])
    """0 is a connection that ended without an answer."""

    seconds: list[float] = field(default_factory=list[float])
    """Of the answers with 200."""

    wrong: int = 0
    client_s: float = 0.0
    """Processor time of the client: what it takes, the server has not."""


class _Flooder:
    """A client that does as little as can be, so that it is not the bottleneck: bare sockets and one epoll."""

    def __init__(self, port: int, request: bytes, sign: bytes) -> None:
        self.result = Flood()
        self._port, self._request, self._sign = port, request, sign
        self._epoll = select.epoll()
        self._buffer = memoryview(bytearray(1 << 20))
        self._open: dict[int, tuple[socket.socket, float, list[bytes]]] = {}

    def __len__(self) -> int:
        return len(self._open)

    def start(self) -> None:
        self.result.sent += 1
        connection = socket.socket()
        connection.setblocking(False)
        connection.connect_ex(("127.0.0.1", self._port))
        self._open[connection.fileno()] = (connection, time.perf_counter(), [])
        try:
            connection.send(self._request)  # it fits into the socket's buffer; here there is a connection by now
            self._epoll.register(connection, select.EPOLLIN)
        except BlockingIOError:
            self._epoll.register(connection, select.EPOLLOUT)

    def poll(self, seconds: float) -> None:
        for descriptor, events in self._epoll.poll(seconds):
            connection, began, pieces = self._open[descriptor]
            try:
                if events == select.EPOLLOUT:
                    connection.send(self._request)
                    self._epoll.modify(descriptor, select.EPOLLIN)
                    continue
                while size := connection.recv_into(self._buffer):
                    pieces.append(bytes(self._buffer[:size]))
            except BlockingIOError:
                continue
            except OSError:
                pass
            del self._open[descriptor]
            connection.close()
            self._finish(began, b"".join(pieces))

    def _finish(self, began: float, answer: bytes) -> None:
        status = int(answer[9:12]) if answer else 0
        self.result.statuses[status] += 1
        if status == 200:
            self.result.seconds.append(time.perf_counter() - began)
            self.result.wrong += self._sign not in answer

    def end(self, patience: float) -> None:
        end = time.monotonic() + patience
        while self._open and time.monotonic() < end:
            self.poll(0.1)
        for connection, _, _ in self._open.values():
            connection.close()
        self._epoll.close()


def flood(
    port: int, request: bytes, sign: bytes, seconds: float, *, rate: float | None = None, clients: int = 0
) -> Flood:
    """Offer a request, whose header says ``Connection: close``; answers of 200 hold ``sign``.

    Either at a ``rate``, whether or not answers come, or from so many ``clients`` that each wait for their answer.
    """
    flooder, began, spent = _Flooder(port, request, sign), time.monotonic(), time.process_time()
    while (now := time.monotonic()) < began + seconds:
        if rate is None:
            while len(flooder) < clients:
                flooder.start()
        else:
            while flooder.result.sent < (now - began) * rate:
                flooder.start()
        flooder.poll(0.002)
    flooder.result.client_s = time.process_time() - spent
    flooder.end(60.0)
    return flooder.result


def processor_s(pid: int, *, ended: bool = False) -> float:
    """Processor time that a process has used, without its children, or with those that have ended."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return sum(map(int, fields[11 : 15 if ended else 13])) / os.sysconf("SC_CLK_TCK")


def processor_s_of_all(server: int) -> float:
    """Processor time that a server and all processes below it have used, those that have ended among them."""
    return sum(processor_s(pid, ended=True) for pid in (server, *processes(server)))
