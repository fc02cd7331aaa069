"""What the service survives: hostile files, load beyond its capacity, faults, and a long run. Prints Markdown.

What must never be, however slow the machine is, ends it with exit code 1: a 500, 1 % or more of other 5xx for hostile
files, a wrong answer or none, memory that grows.

    python benchmarks/reliability.py PART [--workers N] [--seconds N] [--requests N] [--scale X] [--apart N]

Starts a server of its own with the shipped weights and `--workers` workers (default: 2), on the machine's cores, which
the clients share; with `--apart N` the clients alone have the last N cores, as if they were on a machine of their own.
"""

import argparse
import http.client
import os
import platform
import random
import re
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from app.outputs.registry import MESH_WRITERS
from benchmarks.meshes import chair
from tests import load
from tests.e2e.server import Server, running
from tests.hostile import CLASSES

ROOT = Path(__file__).parents[1]
CHAIR = ("chair.obj", (ROOT / "tests/data/chair.obj").read_bytes())
MIXED = [(path.name, path.read_bytes()) for path in sorted((ROOT / "tests/data").iterdir()) if path.suffix != ".md"]


def where() -> str:
    """What was measured on what: revision, processor, cores, and what else the machine does."""
    command = ["git", "describe", "--always", "--dirty", "--abbrev=7"]
    revision = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()
    cpu = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())
    busy = " ".join(f"{load:.1f}" for load in os.getloadavg())
    name = cpu[1] if cpu else platform.processor()
    return f"at {revision or 'no revision'} on {name}, {os.cpu_count()} cores; load average before: {busy}"


@contextmanager
def serving(workers: int, apart: int = 0, **settings: str) -> Iterator[Server]:
    """A server with its log in a temporary folder; the clients, this process, have the last ``apart`` cores alone."""
    cores = sorted(os.sched_getaffinity(0))
    if not 0 <= apart < len(cores):
        raise SystemExit(f"--apart {apart} leaves no core to the server: there are {len(cores)}")
    os.sched_setaffinity(0, cores[: len(cores) - apart])
    try:
        with (
            tempfile.TemporaryDirectory() as folder,
            running(Path(folder) / "log", WORKERS=str(workers), LOG_LEVEL="warning", **settings) as server,
        ):
            os.sched_setaffinity(0, cores[-apart:] if apart else cores)
            yield server
    finally:
        os.sched_setaffinity(0, cores)


def require(holds: bool, what: str) -> None:
    """End with exit code 1 unless it holds."""
    if not holds:
        raise SystemExit(f"FAILED: {what}")


def is_chair(answer: dict[str, Any]) -> bool:
    """Whether an answer is the one for the chair."""
    best = answer["planes"][0]
    return bool(answer["mesh"]["faces"] == 260 and best["normal"][0] > 0.999 and abs(best["offset"]) < 0.02)


def percentiles(seconds: list[float]) -> str:
    """Median, 99th percentile and maximum in milliseconds, as table cells."""
    ordered = sorted(seconds) or [0.0]
    at = [ordered[min(int(share * len(ordered)), len(ordered) - 1)] * 1e3 for share in (0.5, 0.99, 1.0)]
    return " | ".join(f"{value:.0f}" for value in at)


def restarts(server: Server) -> dict[str, int]:
    """Workers replaced so far, by reason."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
    connection.request("GET", "/metrics")
    lines = connection.getresponse().read().decode().splitlines()
    connection.close()
    found = [line for line in lines if line.startswith("prsnet_worker_restarts_total{")]
    return {line.split('"')[1]: int(float(line.rsplit(" ", 1)[1])) for line in found}


def hostile(options: argparse.Namespace) -> None:
    """Every hostile file once, one after the other."""
    print("| class | files | answers | slowest, s | workers replaced |\n| --- | --- | --- | --- | --- |")
    total, answered = Counter[str](), 0
    with serving(options.workers, DEADLINE_S="20", MAX_UPLOAD_BYTES="100000000") as server:
        before = restarts(server)
        for title, generate in CLASSES.items():
            tally = load.Tally()
            for name, data in generate(options.scale):
                load.count(server.port, load.form(name.replace('"', ""), data), tally, lambda _: True)
            after = restarts(server)
            lost = {reason: after[reason] - before.get(reason, 0) for reason in after}
            replaced = ", ".join(f"{number} {reason}" for reason, number in lost.items() if number) or "none"
            seen = ", ".join(f"{number} × {status}" for status, number in sorted(tally.statuses.items()))
            if tally.broken:
                seen += f", broken: {dict(tally.broken)}"
            print(f"| {title} | {tally.sent} | {seen} | {max(tally.seconds):.2f} | {replaced} |", flush=True)
            total += tally.statuses
            answered += tally.sent
            before = after
        assert load.post(server.port, load.form(*CHAIR))[0] == 200
    broken = sum(number for status, number in total.items() if status[0] == "5")
    print(f"\n{sum(total.values())} files; 5xx: {broken}")
    require(broken < 0.01 * sum(total.values()), f"{broken} answers of 5xx to hostile files")
    require(not any(status.startswith("500") for status in total), "a 500")
    require(answered == sum(total.values()), "a hostile file without an answer")


def overload(options: argparse.Namespace) -> None:
    """Open load at multiples of the measured capacity."""
    body = load.form(*CHAIR)
    request = load.head(len(body)).removesuffix(b"\r\n") + b"Connection: close\r\n\r\n" + body
    sign = b'"faces":260'
    with serving(options.workers, options.apart) as server:
        load.flood(server.port, request, sign, 1.0, clients=4 * options.workers)
        closed = load.flood(server.port, request, sign, options.seconds, clients=4 * options.workers)
        capacity = len(closed.seconds) / options.seconds
        print(
            f"Capacity, {4 * options.workers} clients in a closed loop, {options.workers} workers: {capacity:.1f} "
            f"requests/s\n\n| offered | sent/s | 200/s | of the capacity | 503 | other | wrong | 200: p50, ms | p99 "
            "| slowest | server, ms a request | client |\n" + "| --- " * 12 + "|"
        )
        for times in (1, 2, 10):
            spent = load.processor_s(server.process.pid)
            seen = load.flood(server.port, request, sign, options.seconds, rate=times * capacity)
            spent = load.processor_s(server.process.pid) - spent
            served, refused = seen.statuses[200], seen.statuses[503]
            print(
                f"| {times}× | {seen.sent / options.seconds:.0f} | {served / options.seconds:.1f} | "
                f"{100 * served / options.seconds / capacity:.0f} % | {100 * refused / seen.sent:.0f} % | "
                f"{seen.sent - served - refused} | {seen.wrong} | {percentiles(seen.seconds)} | "
                f"{1e3 * spent / seen.sent:.2f} | {1e3 * seen.client_s / seen.sent:.2f} |",
                flush=True,
            )
            require(seen.wrong == 0 and served + refused == seen.sent, "answers that are wrong, missing, or others")


def isolation(options: argparse.Namespace) -> None:
    """What workers of their own cost, for every request (or for clients that never come twice), or one client."""
    print(
        "| mesh | `PRSNET_ISOLATION` | one at a time: p50, ms | p99 | slowest "
        "| all cores: answers/s | processor, ms a request | p50, ms | p99 | slowest |"
    )
    print("| --- " * 10 + "|")
    finer = MESH_WRITERS["stl"].file(*chair(4_608))
    for title, body in (("260 faces", load.form(*CHAIR)), ("4,608 faces", load.form("chair.stl", finer))):
        request = load.head(len(body)).removesuffix(b"\r\n") + b"Connection: close\r\n\r\n" + body
        for mode in ("none", "client", "request"):
            with serving(options.workers, ISOLATION=mode) as server:
                load.flood(server.port, request, b'"planes"', 1.0, clients=1)
                alone = load.flood(server.port, request, b'"planes"', options.seconds / 2, clients=1)
                spent = load.processor_s_of_all(server.process.pid)
                many = load.flood(server.port, request, b'"planes"', options.seconds, clients=4 * options.workers)
                spent = load.processor_s_of_all(server.process.pid) - spent
                print(
                    f"| {title} | {mode} | {percentiles(alone.seconds)} | {len(many.seconds) / options.seconds:.1f} | "
                    f"{1e3 * spent / many.sent:.1f} | {percentiles(many.seconds)} |",
                    flush=True,
                )
                assert set(alone.statuses) == set(many.statuses) == {200}


def renewal(options: argparse.Namespace) -> None:
    """What it costs that workers come from a new process now and then: more clients than workers, in turn."""
    print(
        "| `PRSNET_RENEW_S` | answers | processor, ms an answer | memory at most, MB | workers replaced "
        "| p50, ms | p99 | slowest |\n" + "| --- " * 8 + "|"
    )
    body = load.form(*CHAIR)
    heads = [
        load.head(len(body)).removesuffix(b"\r\n") + b"X-Client: %d\r\nConnection: close\r\n\r\n" % n
        for n in range(options.workers + 2)
    ]
    for after in ("0", "10"):
        with serving(options.workers, RENEW_S=after, CLIENT_ADDRESS_HEADER="X-Client") as server:
            before, most, seen = load.processor_s_of_all(server.process.pid), 0, list[load.Flood]()
            end = time.monotonic() + 2 * options.seconds
            while time.monotonic() < end:
                for head in heads:
                    seen.append(load.flood(server.port, head + body, b'"faces":260', 0.05, rate=20))
                most = max(most, load.resident_kb(server.process.pid)) if len(seen) % 20 == 0 else most
            spent = load.processor_s_of_all(server.process.pid) - before
            times = [one for flood in seen for one in flood.seconds]
            print(
                f"| {after} | {len(times)} | {1e3 * spent / len(times):.1f} | {most / 1024:.0f} | {restarts(server)} | "
                f"{percentiles(times)} |",
                flush=True,
            )
            require({status for flood in seen for status in flood.statuses} == {200}, "an answer that is no 200")


def health(options: argparse.Namespace) -> None:
    """Latency of the probes while all workers are busy and a 100 MB upload runs."""
    print("| while | probes | statuses | p50, ms | p99 | slowest |\n| --- | --- | --- | --- | --- | --- |")
    body, big = load.form(*CHAIR), load.form("big.stl", bytes(100_000_000))
    with serving(options.workers, MAX_UPLOAD_BYTES="110000000") as server:
        for title, busy in (("idle", False), ("all workers busy, 100 MB uploads", True)):
            threads: list[load.Background] = []
            if busy:
                loads = [body] * 2 * options.workers + [big]
                threads = [
                    load.Background(lambda b=b: load.count(server.port, b, load.Tally(), is_chair)) for b in loads
                ]
            for path in ("/health", "/metrics"):
                seconds, statuses = list[float](), Counter[int]()
                end = time.monotonic() + options.seconds / 2
                while time.monotonic() < end:
                    load.probe(server.port, path, seconds, statuses)
                    time.sleep(0.01)
                print(f"| {title}: `{path}` | {len(seconds)} | {dict(statuses)} | {percentiles(seconds)} |", flush=True)
            for thread in threads:
                thread.stop()


def attacks(options: argparse.Namespace) -> None:
    """Connections that are meant to crowd others out, and what a client sees who behaves."""
    body = load.form(*CHAIR)
    live = b"GET /health/live HTTP/1.1\r\nHost: t\r\n\r\n"
    schema = b"GET /openapi.json HTTP/1.1\r\nHost: t\r\n\r\n"
    trickle = load.head(1_000_000) + body[:200]
    costly = next(load.form(name, data) for name, data in CLASSES["crossing"](1.0) if name == "crossing10000.ply")
    crossing = load.head(len(costly)).removesuffix(b"\r\n") + b"X-Forwarded-For: 192.0.2.1\r\n\r\n" + costly
    print(
        "| attack | server before, MB | at most | `/health`: p50, ms | p99 | slowest "
        "| meshes: 200 | other | p50, ms | p99 | slowest |\n" + "| --- " * 11 + "|"
    )
    for title, count, start, again, before_s in (
        ("40 connections pipeline `/health/live`", 40, live * 7000, live * 1000, 1.5),
        ("10 connections pipeline `/openapi.json`", 10, schema * 4000, schema * 1000, 1.5),
        ("64 uploads of a byte a second", 64, trickle, b"v", 1.5),
        ("1,200 idle connections", 1200, b"", b"", 1.5),
        ("18 connections of another address send 10,000 crossing faces again and again", 18, crossing, crossing, 1.5),
    ):
        # What is queued in the end must not keep the server from ending.
        special = {"CLIENT_ADDRESS_HEADER": "X-Forwarded-For", "DEADLINE_S": "10"} if start is crossing else {}
        with serving(options.workers, **special) as server:
            tally, seconds, statuses = load.Tally(), list[float](), Counter[int]()
            before = most = load.resident_kb(server.process.pid)
            attackers = [attack(server.port, start) for _ in range(count)]
            time.sleep(before_s)  # attackers are told from others by then
            honest = load.Background(
                lambda port=server.port, tally=tally: load.count(port, body, tally, is_chair), 0.05
            )
            end, due = time.monotonic() + options.seconds, time.monotonic()
            while time.monotonic() < end:
                if time.monotonic() > due:
                    due += 1.0
                    attackers = [one if send(one, again) else attack(server.port, start) for one in attackers]
                    most = max(most, load.resident_kb(server.process.pid))
                load.probe(server.port, "/health", seconds, statuses)
                time.sleep(0.05)
            honest.stop()
            for one in attackers:
                one.close()
            served = tally.statuses["200"]
            outcomes = sorted((tally.statuses + tally.broken).items())
            others = ", ".join(f"{count} × {what}" for what, count in outcomes if what != "200") or "0"
            print(
                f"| {title} | {before / 1024:.0f} | {most / 1024:.0f} | {percentiles(seconds)} | {served} | "
                f"{others} | {percentiles(tally.seconds)} |",
                flush=True,
            )


def attack(port: int, start: bytes) -> socket.socket:
    """A connection that never reads."""
    connection = socket.create_connection(("127.0.0.1", port), timeout=30)
    connection.setblocking(False)
    send(connection, start)
    return connection


def send(connection: socket.socket, data: bytes) -> bool:
    """Send what fits; False when the other side hung up."""
    try:
        if data:
            connection.send(data)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return True


def chaos(options: argparse.Namespace) -> None:
    """Workers are killed and clients leave at random while a checker counts."""
    body, chance, killed, tally = load.form(*CHAIR), random.Random(7), list[int](), load.Tally()
    left = [0]
    with serving(options.workers) as server:

        def leave() -> None:
            load.hang_up(server.port, body, random.Random(chance.random()))
            left[0] += 1

        threads = [load.Background(lambda: load.count(server.port, body, tally, is_chair)) for _ in range(4)]
        threads.append(load.Background(leave, 0.1))
        threads.append(load.Background(lambda: load.kill_one(server.process.pid, chance, killed), 0.5))
        time.sleep(options.seconds)
        for thread in threads:
            thread.stop()
        print(f"{len(killed)} workers killed, {left[0]} clients left, in {options.seconds:.0f} s")
        print(f"{tally.sent} requests, answers: {dict(tally.statuses)}, without one: {dict(tally.broken)}")
        print(f"wrong answers: {len(tally.wrong)}; replaced: {restarts(server)}")
        require(not tally.wrong and not tally.broken, "answers that are wrong or missing")
        require("500 internal-error" not in tally.statuses, "a 500")


def soak(options: argparse.Namespace) -> None:
    """Mixed requests, good and hostile, and the memory of all processes together on the way."""
    bad = [file for title in ("truncations", "tiny", "bad indices", "xml", "names") for file in CLASSES[title](0.1)]
    chance = random.Random(1)
    statuses: Counter[str] = Counter()
    lock = threading.Lock()
    left = [options.requests]
    with serving(options.workers, WORKER_JOBS="500", RENEW_S="60") as server:

        def work() -> None:
            while True:
                with lock:
                    if left[0] == 0:
                        return
                    left[0] -= 1
                    name, data = chance.choice(MIXED) if chance.random() < 0.5 else chance.choice(bad)
                tally = load.Tally()
                load.count(server.port, load.form(name.replace('"', ""), data), tally, lambda _: True)
                with lock:
                    statuses.update(tally.statuses + Counter({f"broken {k}": n for k, n in tally.broken.items()}))

        threads = [threading.Thread(target=work) for _ in range(2 * options.workers)]
        for thread in threads:
            thread.start()
        marks = sorted({1000, *(options.requests * step // 10 for step in range(1, 11))})
        print("| requests | memory of all processes, MB |\n| --- | --- |")
        after_1000, now = 0, 0
        for mark in marks:
            while options.requests - left[0] < mark and any(thread.is_alive() for thread in threads):
                time.sleep(0.05)
            now = load.resident_kb(server.process.pid)
            after_1000 = now if mark == 1000 else after_1000
            print(f"| {mark} | {now / 1024:.0f} |", flush=True)
        for thread in threads:
            thread.join()
        print(f"\nanswers: {dict(statuses)}; replaced: {restarts(server)}")
        while len([above for above in load.processes(server.process.pid).values() if above == server.process.pid]) > 1:
            time.sleep(0.1)  # workers are about to come from a new process, whose memory comes on top for a moment
        now = load.resident_kb(server.process.pid)
        if after_1000:
            print(f"growth after the first 1,000: {100 * (now / after_1000 - 1):+.1f} %")
            require(now < 1.3 * after_1000, "memory grows")
        require(not any(status[0] in "5b" for status in statuses), "a 5xx, or no answer")


def main() -> None:
    """Parse the command line and run one part."""
    parts = {
        "hostile": hostile, "load": overload, "isolation": isolation, "renewal": renewal, "health": health,
        "attacks": attacks, "chaos": chaos, "soak": soak,
    }  # fmt: skip
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=parts)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each measurement (default: 20)")
    parser.add_argument("--requests", type=int, default=20_000, help="of the soak (default: 20000)")
    parser.add_argument(
        "--apart", type=int, default=0, help="cores that are the clients' alone, for `load` (default: 0)"
    )
    parser.add_argument("--scale", type=float, default=1.0, help="of the hostile files (default: 1)")
    options = parser.parse_args()
    print(f"`{options.part}` {where()}\n", flush=True)
    parts[options.part](options)


if __name__ == "__main__":
    main()
