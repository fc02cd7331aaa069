"""Starts and stops a real server process."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

ROOT = Path(__file__).parents[2]
START_LIMIT_S = 180  # the first start on a machine compiles the kernels


@dataclass
class Server:
    """A running server: where it listens, its process, its log."""

    url: str
    process: "subprocess.Popen[bytes]"
    log: Path

    @property
    def port(self) -> int:
        return int(self.url.rsplit(":", 1)[1])

    def detect(self, name: str, content: bytes, **query: Any) -> httpx.Response:
        return httpx.post(f"{self.url}/detect", files={"file": (name, content)}, params=query, timeout=60)

    def health(self) -> int:
        return httpx.get(f"{self.url}/health", timeout=60).status_code

    def wait_until_ready(self) -> None:
        end = time.monotonic() + START_LIMIT_S
        while time.monotonic() < end:
            assert self.process.poll() is None, self.log.read_text()
            try:
                if self.health() == 200:
                    return
            except httpx.TransportError:
                pass
            time.sleep(0.05)
        raise AssertionError(f"not ready after {START_LIMIT_S} s:\n{self.log.read_text()}")


@contextmanager
def launched(log: Path, **settings: str) -> Iterator[Server]:
    """A server process that may still be starting; ``settings`` without their prefix. No answer is kept, unless asked.

    Most tests send one file again and again to have it worked on again and again.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PRSNET_")}
    environment |= {"PRSNET_DRAIN_S": "0.5", "PRSNET_CACHE_BYTES": "0"} | {
        f"PRSNET_{name}": value for name, value in settings.items()
    }
    with log.open("wb") as output:
        process = subprocess.Popen(
            [sys.executable, "-W", "error", "-m", "app", "serve", "--port", str(port)],
            cwd=ROOT, env=environment, stdout=output, stderr=subprocess.STDOUT,
        )  # fmt: skip
    try:
        yield Server(f"http://127.0.0.1:{port}", process, log)
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.wait(30)
        finally:
            process.kill()


@contextmanager
def running(log: Path, **settings: str) -> Iterator[Server]:
    """A server that is ready to serve."""
    with launched(log, **settings) as server:
        server.wait_until_ready()
        yield server
