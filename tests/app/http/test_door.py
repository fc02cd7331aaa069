"""Connections as they come in: who is answered at the door, and who gets a protocol."""

import asyncio
import json
from collections.abc import AsyncGenerator, Callable
from contextlib import ExitStack, asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest

from app.http.door import Door, listen
from app.http.gate import Arrival, Gate
from app.http.metrics import Metrics
from app.settings import Settings
from app.workers.turns import Places

pytestmark = pytest.mark.anyio

WELCOME = b"HTTP/1.1 200 OK\r\ncontent-length: 0\r\nconnection: close\r\n\r\n"


@dataclass
class Pool:
    """What the gate asks of a pool: places, of which ``taken`` are."""

    places: Places
    card: Any = "loaded"
    admitted: int = 0
    running: int = 0


class Inside(asyncio.Protocol):
    """Takes what it is told and answers at the end of a header."""

    def __init__(self, came: list[bytes]) -> None:
        self._came, self._at = came, len(came)
        came.append(b"")

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport: Any = transport

    def data_received(self, data: bytes) -> None:
        self._came[self._at] += data
        if b"\r\n\r\n" in self._came[self._at]:
            self._transport.write(WELCOME)
            self._transport.close()


@dataclass
class House:
    port: int
    gate: Gate
    metrics: Metrics
    door: Door = field(init=False)
    came: list[bytes] = field(default_factory=list[bytes])
    arrivals: list[Arrival | None] = field(default_factory=list[Arrival | None])

    async def ask(self, request: bytes, hang_up: bool = False) -> bytes:
        """All that is answered to what is sent at once."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
        try:
            writer.write(request)
            await writer.drain()
            if hang_up:
                writer.write_eof()
            async with asyncio.timeout(20):
                return await reader.read()
        finally:
            writer.close()


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(30):
        while not condition():
            await asyncio.sleep(0.005)


@asynccontextmanager
async def house(places: int, taken: int = 0, most_lingering: int = 100, **settings: Any) -> AsyncGenerator[House]:
    pool, metrics = Pool(Places(places, places)), Metrics()
    gate = Gate(Settings(_env_file=None, **settings), pool, metrics)  # type: ignore[arg-type,call-arg]
    sockets = listen("127.0.0.1", 0)
    made = House(sockets[0].getsockname()[1], gate, metrics)

    def protocol(arrival: Arrival | None) -> asyncio.Protocol:
        made.arrivals.append(arrival)
        return Inside(made.came)

    with ExitStack() as stack:
        for _ in range(taken):
            stack.enter_context(pool.places.one("another"))
        door = made.door = Door(sockets, gate, protocol, linger_s=20.0, most_lingering=most_lingering)
        try:
            yield made
        finally:
            door.close()
            await door.wait_closed()


def post(body: bytes, *fields: str, length: int | None = None, path: str = "/detect") -> bytes:
    size = len(body) if length is None else length
    lines = [f"POST {path} HTTP/1.1", "Host: t", f"Content-Length: {size}", *fields, "", ""]
    return "\r\n".join(lines).encode() + body


def problem(answer: bytes, status: int) -> dict[str, Any]:
    """The document of an answer that is whole and the last of its connection."""
    head, _, content = answer.partition(b"\r\n\r\n")
    first, *lines = head.decode().split("\r\n")
    fields = dict(line.split(": ", 1) for line in lines)
    document = json.loads(content)
    assert int(first.split()[1]) == document["status"] == status
    assert int(fields["content-length"]) == len(content)
    assert fields["x-request-id"] == document["request_id"]
    assert fields["connection"] == "close"
    assert (fields["content-type"], fields["x-content-type-options"]) == ("application/problem+json", "nosniff")
    return document


@pytest.mark.parametrize("last", [(), ("Connection: close",)])
async def test_who_finds_no_room_is_told_so_and_gets_no_protocol(last: tuple[str, ...]) -> None:
    async with house(2, taken=2) as full:
        answer = await full.ask(post(b"v" * 3000, "X-Request-ID: mine", *last))
        assert problem(answer, 503)["request_id"] == "mine"
        assert b"retry-after: 1\r\n" in answer
        assert full.came == []
        assert b'prsnet_requests_total{method="POST",route="/detect",status="503"} 1.0' in full.metrics.text()


async def test_a_refusal_comes_before_the_body_and_survives_it() -> None:
    """It reaches clients that send all of their body first, and those that wait for it with half of theirs."""
    async with house(1, taken=1) as full:
        whole = post(bytes(30_000_000))
        assert problem(await full.ask(whole, hang_up=True), 503)
        assert problem(await full.ask(post(b"", length=10_000_000)), 503)
        assert problem(await full.ask(post(b"", "Expect: 100-continue", length=10_000_000)), 503)
        assert full.came == []


async def test_what_is_let_in_arrives_whole_however_it_comes() -> None:
    async with house(2, taken=2) as full:
        for request in (b"GET /health HTTP/1.1\r\nHost: t\r\n\r\n", b"\x00not HTTP\r\n\r\n", b"POST nowhere\r\n\r\n"):
            assert await full.ask(request) == WELCOME
            assert full.came.pop() == request
        late = post(b"")  # cut within its header, it is the protocol's
        reader, writer = await asyncio.open_connection("127.0.0.1", full.port)
        writer.write(late[:20])
        await until(lambda: full.came == [late[:20]])
        writer.write(late[20:])
        assert await reader.read() == WELCOME
        writer.close()
        assert full.came == [late]
    async with house(2, taken=1) as free:
        request = post(b"v" * 100_000)
        assert await free.ask(request) == WELCOME
        assert free.came[0] == request[: len(free.came[0])]
        assert free.arrivals[0] is not None


async def test_who_says_nothing_is_let_in() -> None:
    async with house(1, taken=1) as full:
        _, writer = await asyncio.open_connection("127.0.0.1", full.port)
        await until(lambda: full.came == [b""])
        writer.close()


async def test_those_that_come_at_the_same_moment_do_not_rely_on_one_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.http.gate._ARRIVING_S", 60.0)
    async with house(3, taken=1) as narrow:
        answers = await asyncio.gather(*[narrow.ask(post(b"v", "Connection: close")) for _ in range(8)])
        assert answers.count(WELCOME) == 2
        assert [problem(answer, 503)["type"] for answer in answers if answer != WELCOME] == ["/problems/overloaded"] * 6


async def test_a_wrong_key_is_seen_first_and_leaves_the_connection_to_the_protocol() -> None:
    async with house(1, taken=1, api_keys="right") as full:
        assert problem(await full.ask(post(b"v", "Connection: close")), 401)
        assert await full.ask(post(b"v")) == WELCOME  # which says the same, and goes on
        assert problem(await full.ask(post(b"v", "X-API-Key: right")), 503)


async def test_only_so_many_refused_clients_are_waited_for() -> None:
    async with house(1, taken=1, most_lingering=2) as full:
        waiting = [asyncio.create_task(full.ask(post(b"", length=1000))) for _ in range(2)]
        assert [problem(await one, 503)["status"] for one in waiting] == [503, 503]
        await until(lambda: full.door.lingering == 0)  # those two have left
        held = [await asyncio.open_connection("127.0.0.1", full.port) for _ in range(3)]
        for _, writer in held:
            writer.write(post(b"", length=1000))
        answers = sorted([await reader.read(12) for reader, _ in held])
        assert answers == [b"HTTP/1.1 200", b"HTTP/1.1 503", b"HTTP/1.1 503"]
        for _, writer in held:
            writer.close()


def test_what_cannot_be_listened_at_is_told() -> None:
    (first,) = listen("127.0.0.1", 0)
    with first, pytest.raises(OSError, match="in use"):
        listen("127.0.0.1", first.getsockname()[1])
    with pytest.raises(OSError, match="assign"):
        listen("192.0.2.1", 0)
