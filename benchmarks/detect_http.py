"""Latency and throughput of ``POST /detect`` over loopback, with the worker's own breakdown.

    python benchmarks/detect_http.py [--file MESH] [--clients 2 --workers 2] [--mode paper]

Starts a server of its own with the shipped weights, sends the same file again and again, prints a table, and
ends by itself after ``--requests`` answers or ``--seconds`` seconds, whichever comes first.
"""

import argparse
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.client import HTTPConnection
from pathlib import Path

import numpy as np
import trimesh
from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[1]
STEPS = ("parse", "voxelize", "infer", "refine", "validate", "total")
START_LIMIT_S = 180
WARM_UP = 10


def chair_of_boxes() -> bytes:
    """An OBJ of 4,608 faces with one mirror plane: seat, back and four legs, each a finely divided box."""
    parts = [((1.0, 0.1, 1.0), (0.0, 0.5, 0.0)), ((1.0, 0.8, 0.1), (0.0, 0.95, -0.45))]
    parts += [((0.1, 0.5, 0.1), (x, 0.2, z)) for x in (-0.4, 0.4) for z in (-0.4, 0.4)]
    boxes = []
    for extents, center in parts:
        box = trimesh.creation.box(extents)
        for _ in range(3):
            box = box.subdivide()
        box.apply_translation(center)
        boxes.append(box)
    return trimesh.util.concatenate(boxes).export(file_type="obj").encode()


@contextmanager
def server(workers: int) -> Iterator[int]:
    """A server process on a free port; yields the port once it is ready."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "app", "serve", "--port", str(port), "--workers", str(workers)]
    process = subprocess.Popen(
        [*command, "--log-level", "error"],
        cwd=ROOT,
        env=os.environ | {"PRSNET_DRAIN_S": "0", "PRSNET_CACHE_BYTES": "0"},
    )
    try:
        end = time.monotonic() + START_LIMIT_S
        while not ready(port):
            if process.poll() is not None or time.monotonic() > end:
                sys.exit("the server did not start")
            time.sleep(0.05)
        yield port
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(30)
        except subprocess.TimeoutExpired:
            process.kill()


def ready(port: int) -> bool:
    """Whether ``/health`` says 200."""
    try:
        connection = HTTPConnection("127.0.0.1", port, timeout=5)
        connection.request("GET", "/health")
        return connection.getresponse().status == 200
    except OSError:
        return False


def multipart(filename: str, content: bytes) -> tuple[bytes, str]:
    """The request body and its content type."""
    boundary = "benchmark-5c1b0f"
    head = f'--{boundary}\r\nContent-Disposition: form-data; name="file"; filename="{filename}"\r\n\r\n'
    return (
        head.encode() + content + f"\r\n--{boundary}--\r\n".encode(),
        f"multipart/form-data; boundary={boundary}",
    )


class Client(threading.Thread):
    """Sends one request after the other over one connection until told to stop."""

    def __init__(self, port: int, path: str, body: bytes, content_type: str, count: int, end: float) -> None:
        super().__init__(daemon=True)
        self.port, self.path, self.body, self.content_type = port, path, body, content_type
        self.count, self.end = count, end
        self.rows: list[dict[str, float]] = []
        self.failure = ""

    def run(self) -> None:
        """Collect one row of milliseconds for each answer."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=60)
        while len(self.rows) < self.count and time.monotonic() < self.end:
            started = time.perf_counter()
            connection.request("POST", self.path, self.body, {"Content-Type": self.content_type})
            response = connection.getresponse()
            answer = json.loads(response.read())
            elapsed = (time.perf_counter() - started) * 1e3
            if response.status != 200:
                self.failure = f"{response.status}: {answer.get('detail')}"
                return
            self.rows.append({"request": elapsed, **answer["timings_ms"]})


def measure(port: int, path: str, name: str, content: bytes, clients: int, count: int, end: float) -> list[Client]:
    """Run ``clients`` threads of ``count`` requests each."""
    body, content_type = multipart(name, content)
    threads = [Client(port, path, body, content_type, count, end) for _ in range(clients)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
        if thread.failure:
            sys.exit(thread.failure)
    return threads


def main() -> None:
    """Parse the command line, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--file", type=Path, help="mesh to send (default: a generated OBJ of 4,608 faces)")
    parser.add_argument("--requests", type=int, default=200, help="requests of each client (default: 200)")
    parser.add_argument("--clients", type=int, default=1, help="clients at a time (default: 1)")
    parser.add_argument("--workers", type=int, default=1, help="worker processes of the server (default: 1)")
    parser.add_argument("--mode", choices=("full", "paper"), default="full")
    parser.add_argument("--seconds", type=float, default=60.0, help="longest time to measure (default: 60)")
    options = parser.parse_args()
    name = options.file.name if options.file else "chair_of_boxes.obj"
    content = options.file.read_bytes() if options.file else chair_of_boxes()
    path = f"/detect?mode={options.mode}"
    with server(options.workers) as port:
        end = time.monotonic() + options.seconds
        measure(port, path, name, content, options.clients, WARM_UP, end)
        started = time.perf_counter()
        threads = measure(port, path, name, content, options.clients, options.requests, end)
        elapsed = time.perf_counter() - started
    rows = [row for thread in threads for row in thread.rows]
    if not rows:
        sys.exit("no answer within the time allowed")
    report(
        rows,
        f"{name}, {len(content) / 1e3:.0f} kB, mode={options.mode}",
        elapsed,
        options.clients,
        options.workers,
    )


def report(rows: list[dict[str, float]], title: str, elapsed: float, clients: int, workers: int) -> None:
    """Print medians and 95th percentiles."""
    table = Table(title=f"POST /detect, {title}", title_justify="left")
    table.add_column("step")
    table.add_column("p50 ms", justify="right")
    table.add_column("p95 ms", justify="right")
    around = [row["request"] - row["total"] for row in rows]
    columns = {step: [row[step] for row in rows] for step in STEPS}
    columns |= {
        "HTTP, upload, waiting, JSON": around,
        "request, at the client": [row["request"] for row in rows],
    }
    for step, values in columns.items():
        p50, p95 = np.percentile(values, [50, 95])
        table.add_row(step if step != "total" else "worker, total", f"{p50:.2f}", f"{p95:.2f}")
    console = Console()
    console.print(table)
    rate = len(rows) / elapsed
    console.print(f"{len(rows)} requests, {clients} client(s), {workers} worker(s): {rate:.1f} requests/s")


if __name__ == "__main__":
    main()
