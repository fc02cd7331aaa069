"""Runs the application under uvicorn: logging, draining before the port closes, a meaningful exit code."""

import asyncio
import errno
import logging
import math
import signal
import socket
import time
from types import FrameType
from typing import Any

import uvicorn

from app import logs
from app.http.door import Door, listen
from app.http.gate import Arrival
from app.http.main import create_app
from app.http.protocol import bounded
from app.http.runtime import Runtime
from app.settings import Settings

logger = logging.getLogger("prsnet")


class DrainingServer(uvicorn.Server):
    """After SIGTERM it first only says 503 on ``/health``, then closes the port and finishes what runs.

    Load balancers need that time to notice. SIGINT (a person at a terminal) and a second signal skip it.
    """

    def __init__(self, config: uvicorn.Config, runtime: Runtime) -> None:
        super().__init__(config)
        self._runtime = runtime
        self._close_at = math.inf

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Called by SIGTERM and SIGINT; the signal is not raised again, so an orderly end exits with 0."""
        if self.should_exit:
            self.force_exit = sig == signal.SIGINT
            return
        self._runtime.drain()
        if sig == signal.SIGINT or self._close_at < math.inf:
            self.should_exit = True
        else:
            self._close_at = time.monotonic() + self._runtime.settings.drain_s

    async def on_tick(self, counter: int) -> bool:
        """Called ten times a second: whether to leave the main loop."""
        if time.monotonic() >= self._close_at:
            self.should_exit = True
        return await super().on_tick(counter)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Let in what comes at ``sockets``, and tell where that is."""
        await super().startup([])
        settings = self._runtime.settings

        def protocol(arrival: Arrival | None) -> asyncio.BaseProtocol:
            kind: Any = self.config.http_protocol_class
            made = kind(config=self.config, server_state=self.server_state, app_state=self.lifespan.state)
            made.arrival = arrival
            return made

        servers: list[Any] = self.servers
        servers.append(
            Door(sockets or [], self._runtime.gate, protocol, settings.stall_s, settings.max_connections // 2)
        )
        for listening in sockets or []:
            host, port, *_ = listening.getsockname()
            host = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(host, f"[{host}]" if ":" in host else host)
            logger.info("open http://%s:%d in a browser; Ctrl+C ends the service", host, port)


def serve(settings: Settings) -> int:
    """Serve until a signal. The exit code is 0, or 1 when start-up failed."""
    logs.configure(settings)
    try:
        sockets = listen(settings.host, settings.port)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            logger.error(
                "port %d of %s is in use: choose another one with --port (PRSNET_PORT), or end what listens there",
                settings.port,
                settings.host,
            )
        else:
            logger.error("nothing can listen at port %d of %s: %s", settings.port, settings.host, error.strerror)
        return 1
    app = create_app(settings)
    runtime: Runtime = app.state.runtime
    config = uvicorn.Config(
        app,
        log_config=None,
        access_log=False,  # the middleware logs one line a request, with its id
        server_header=False,
        http=bounded(settings, runtime.gate),
        ws="none",
        timeout_keep_alive=settings.keep_alive_s,
        timeout_graceful_shutdown=math.ceil(settings.deadline_s) + 1,
        lifespan="on",
    )
    server = DrainingServer(config, runtime)
    failures: list[bool] = []

    def give_up() -> None:
        failures.append(True)
        server.should_exit = True

    runtime.on_failure = give_up
    server.run(sockets)
    return 1 if failures else 0
