"""Faults in a real server: workers are killed, clients leave, stall and crawl; whoever behaves is served."""

import os
import random
import signal
import socket
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests import load

from .server import Server, running


@pytest.fixture(scope="module")
def patient(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server that loses patience soon, with room in its queue."""
    settings = {"STALL_S": "1.5", "UPLOAD_S": "5", "QUEUE": "30", "WORKERS": "2", "UPLOADS": "20"}
    with running(tmp_path_factory.mktemp("patient") / "log", **settings) as server:
        yield server


@pytest.fixture
def chair(data: Path) -> bytes:
    return load.form("chair.obj", (data / "chair.obj").read_bytes())


def is_chair(answer: dict[str, Any]) -> bool:
    best = answer["planes"][0]
    return bool(answer["mesh"]["faces"] == 260 and best["normal"][0] > 0.999 and abs(best["offset"]) < 0.02)


def test_every_request_gets_one_right_answer_while_workers_die_and_clients_leave(patient: Server, chair: bytes) -> None:
    chance, tally, killed = random.Random(7), load.Tally(), list[int]()
    server = patient.process.pid
    threads = [load.Background(lambda: load.count(patient.port, chair, tally, is_chair)) for _ in range(3)]
    threads += [
        load.Background(lambda: load.hang_up(patient.port, chair, random.Random(chance.random())), 0.1),
        load.Background(lambda: load.kill_one(server, chance, killed), 0.4),
    ]
    time.sleep(6)
    for thread in threads:
        thread.stop()
    assert killed
    assert not tally.wrong
    assert not tally.broken
    assert set(tally.statuses) <= {"200", "503 worker-lost"}, tally.statuses
    assert tally.statuses["200"] > 0.5 * tally.sent
    assert sum(tally.statuses.values()) == tally.sent
    assert patient.health() == 200
    metrics = httpx.get(f"{patient.url}/metrics").text
    assert 'prsnet_worker_restarts_total{reason="lost"}' in metrics
    assert 'status="500"' not in metrics


def test_the_loss_of_the_zygote_is_made_good(patient: Server, chair: bytes) -> None:
    server = patient.process.pid
    old, workers = load.zygote_of(server), load.workers_of(server)
    os.kill(old, signal.SIGKILL)
    assert load.post(patient.port, chair)[0] == 200  # the workers are still there
    end = time.monotonic() + 120
    while True:
        children = [child for child, above in load.processes(server).items() if above == server]
        if children and children != [old]:
            break
        assert time.monotonic() < end
        time.sleep(0.05)
    assert workers
    for worker in workers:
        os.kill(worker, signal.SIGKILL)  # from now on only the new one's can answer
    status, answer = load.post(patient.port, chair)
    assert (status, is_chair(answer)) == (200, True)


def test_crawling_and_stalled_clients_hold_no_worker_and_are_cut_off(patient: Server, chair: bytes) -> None:
    starts = [b"", b"POST /det", load.head(1000)[:-2], load.head(10**6) + chair[:200], load.head(10**6)]
    crawlers = [socket.create_connection(("127.0.0.1", patient.port), timeout=30) for _ in range(40)]
    try:
        for number, crawler in enumerate(crawlers):
            crawler.sendall(starts[number % len(starts)])
        for _ in range(3):
            assert load.post(patient.port, chair)[0] == 200
        assert patient.health() == 200
        statuses: Counter[bytes] = Counter()
        for crawler in crawlers:
            answer = b""
            while part := crawler.recv(65536):
                answer += part
            statuses[answer[9:12]] += 1
            assert answer == b"" or b"application/problem+json" in answer
        # A header that never ends is hung up on; an upload that stalls is told so, or that there are too many.
        assert set(statuses) <= {b"", b"408", b"503"}
        assert statuses[b""] >= 16
        assert statuses[b"408"] >= 8
    finally:
        for crawler in crawlers:
            crawler.close()


def test_health_and_metrics_answer_while_everything_is_busy(patient: Server, chair: bytes) -> None:
    tally = load.Tally()
    upload = load.form("big.stl", bytes(50_000_000))
    threads = [load.Background(lambda: load.count(patient.port, chair, tally, is_chair)) for _ in range(6)]
    threads.append(load.Background(lambda: load.count(patient.port, upload, load.Tally(), is_chair)))
    busy = 0
    try:
        for _ in range(1000):
            # The answer itself says that both workers were at work and others were waiting when it was made.
            metrics = httpx.get(f"{patient.url}/metrics", timeout=60)
            assert metrics.status_code == 200
            assert patient.health() == 200
            gauges = dict(line.rsplit(" ", 1) for line in metrics.text.splitlines() if not line.startswith("#"))
            busy += float(gauges["prsnet_jobs_running"]) == 2.0 and float(gauges["prsnet_queue_depth"]) >= 1.0
            if busy == 20:
                break
    finally:
        for thread in threads:
            thread.stop()
    assert busy == 20
    assert not tally.wrong
    assert not tally.broken


def test_headers_without_end_and_nonsense_are_refused_as_problems(patient: Server) -> None:
    for start in (b"\x16\x03\x01 nonsense\r\n\r\n", b"GET / HTTP/1.1\r\n" + b"X: " + b"a" * 200_000 + b"\r\n\r\n"):
        with socket.create_connection(("127.0.0.1", patient.port), timeout=30) as connection:
            connection.sendall(start)
            answer = connection.recv(65536)
        assert answer.startswith(b"HTTP/1.1 400 ")
        assert b"application/problem+json" in answer
    assert patient.health() == 200
