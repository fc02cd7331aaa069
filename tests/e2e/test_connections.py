"""What connections may cost a real server: pipelines, trickles, idle crowds, early answers, lazy readers."""

import contextlib
import json
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import load

from .server import Server, running

GET = b"GET /health/live HTTP/1.1\r\nHost: t\r\n\r\n"


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """Few of everything, and little patience."""
    settings = {
        "STALL_S": "2", "WORKERS": "1", "QUEUE": "16", "UPLOADS": "6", "UPLOADS_PER_ADDRESS": "4",
        "MAX_CONNECTIONS": "40", "API_KEYS": "right", "CLIENT_ADDRESS_HEADER": "X-Client",
        "MAX_UPLOAD_BYTES": "40000000",
    }  # fmt: skip
    with running(tmp_path_factory.mktemp("small") / "log", **settings) as server:
        yield server


@pytest.fixture
def chair(data: Path) -> bytes:
    return load.form("chair.obj", (data / "chair.obj").read_bytes())


def connect(server: Server) -> socket.socket:
    return socket.create_connection(("127.0.0.1", server.port), timeout=30)


def request(body: bytes, length: int | None = None, *fields: str, key: str = "right") -> bytes:
    head = load.head(len(body) if length is None else length).removesuffix(b"\r\n")
    lines = [f"X-API-Key: {key}", *fields, "", ""]
    return head + "\r\n".join(lines).encode() + body


def answers(connection: socket.socket, count: int) -> list[tuple[int, bytes]]:
    """So many answers, or as many as there are, from one connection."""
    file, found = connection.makefile("rb"), list[tuple[int, bytes]]()
    while len(found) < count and (line := file.readline()):
        headers = dict(header.lower().split(b":", 1) for header in iter(file.readline, b"\r\n"))
        found.append((int(line.split()[1]), file.read(int(headers[b"content-length"]))))
    return found


def test_pipelined_requests_are_answered_one_after_the_other(small: Server) -> None:
    with connect(small) as connection:
        connection.sendall(GET * 50)
        seen = answers(connection, 50)
    assert [status for status, _ in seen] == [200] * 50
    with connect(small) as connection:  # cut anywhere, the end of a header included
        whole = GET * 3
        for at in range(len(whole)):
            connection.sendall(whole[at : at + 1])
        assert [status for status, _ in answers(connection, 3)] == [200] * 3


def test_requests_cut_anywhere_keep_their_order(small: Server) -> None:
    """Bytes that arrive while those before them wait for their turn come after them."""
    whole = GET * 6
    for _ in range(60):
        with connect(small) as connection:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            for at in range(len(whole)):
                connection.sendall(whole[at : at + 1])
            assert [status for status, _ in answers(connection, 6)] == [200] * 6


def test_what_follows_an_upload_waits_for_its_answer(small: Server, chair: bytes) -> None:
    with connect(small) as connection:
        connection.sendall(request(chair) + GET + request(chair) + GET)
        seen = answers(connection, 4)
    assert [status for status, _ in seen] == [200] * 4
    assert [json.loads(body).get("status") for _, body in seen] == [None, "alive", None, "alive"]


def test_a_flood_of_pipelined_requests_costs_little_memory(small: Server) -> None:
    before = load.resident_kb(small.process.pid)
    flooders = [connect(small) for _ in range(20)]
    try:
        for flooder in flooders:
            flooder.setblocking(False)
        end = time.monotonic() + 1.5
        while time.monotonic() < end:
            for flooder in flooders:
                try:
                    flooder.send(GET * 4000)
                except BlockingIOError:
                    pass
                except OSError:  # it was hung up on
                    pass
            assert small.health() == 200
        assert load.resident_kb(small.process.pid) - before < 60_000
    finally:
        for flooder in flooders:
            flooder.close()


def test_trickling_uploads_keep_nobody_out(small: Server, chair: bytes) -> None:
    """All slots are taken by clients of many addresses that send a byte now and then."""
    crawlers = [connect(small) for _ in range(6)]
    try:
        for number, crawler in enumerate(crawlers):
            crawler.sendall(request(chair[:150], 100_000, f"X-Client: 10.0.0.{number}"))
        time.sleep(1.2)
        for _ in range(3):
            with connect(small) as connection:
                connection.sendall(request(chair, None, "X-Client: 10.1.1.1"))
                assert answers(connection, 1)[0][0] == 200
        statuses = list[int]()
        end = time.monotonic() + 20
        for crawler in crawlers:
            crawler.settimeout(0.1)
            while time.monotonic() < end:
                try:
                    if not (part := crawler.recv(65536)):
                        break
                    statuses.append(int(part.split()[1]))
                    break
                except TimeoutError:
                    for other in crawlers:
                        with contextlib.suppress(OSError):
                            other.send(b"v")
        assert statuses == [408] * 6
    finally:
        for crawler in crawlers:
            crawler.close()


def test_idle_connections_make_room_for_new_ones(small: Server) -> None:
    crowd = list[socket.socket]()
    try:
        for _ in range(60):  # of which the server keeps 40
            crowd.append(connect(small))
        for _ in range(5):
            assert small.health() == 200
    finally:
        for connection in crowd:
            connection.close()


@pytest.mark.parametrize("size", [1000, 30_000_000])
@pytest.mark.parametrize(("key", "status"), [("wrong", 401), ("right", 413)])
def test_a_refusal_reaches_a_client_that_sends_all_of_its_body_first(
    small: Server, key: str, status: int, size: int
) -> None:
    length = size if key == "wrong" else 40_000_001
    with connect(small) as connection:
        connection.sendall(request(bytes(length), length, key=key))
        seen = answers(connection, 1)
        assert [status for status, _ in seen] == [status]
        problem = json.loads(seen[0][1])
        assert problem["status"] == status
        connection.sendall(GET)
        assert [status for status, _ in answers(connection, 1)] in ([200], [])  # it may have been the last


def test_refusals_are_whole_problems_counted_and_logged_in_few_lines(small: Server, chair: bytes) -> None:
    with connect(small) as connection:
        for _ in range(30):  # over one connection: the bodies are thrown away
            connection.sendall(request(chair, None, "X-Request-ID: mine", key="wrong"))
            ((status, body),) = answers(connection, 1)
            document = json.loads(body)
            assert (status, document["type"], document["request_id"]) == (401, "/problems/unauthorized", "mine")
    with connect(small) as connection:
        connection.sendall(b"GET /metrics HTTP/1.1\r\nHost: t\r\nX-API-Key: right\r\n\r\n")
        counted = answers(connection, 1)[0][1].decode()
    assert 'prsnet_requests_total{method="POST",route="/detect",status="401"}' in counted
    assert 'prsnet_rejections_total{reason="unauthorized"}' in counted
    time.sleep(1.2)
    lines = [line for line in small.log.read_text().splitlines() if "refused" in line and "unauthorized" in line]
    assert 1 <= len(lines) <= 8


def test_a_client_that_does_not_read_is_no_defect(small: Server, data: Path) -> None:
    plane = "/complete?normal=1,0,0&format=obj"
    body = load.form("plant.off", (data / "plant.off").read_bytes())
    with socket.socket() as lazy:
        lazy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
        lazy.settimeout(30)
        lazy.connect(("127.0.0.1", small.port))
        head = load.head(len(body), plane).removesuffix(b"\r\n") + b"X-API-Key: right\r\n\r\n"
        for _ in range(3):
            lazy.sendall(head + body)
        time.sleep(5)
    assert small.health() == 200
    log = small.log.read_text()
    assert "defect" not in log
    assert "Traceback" not in log
