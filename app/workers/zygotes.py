"""The processes that workers are forked from, one after the other: a new one when one ends, or its addresses are old.

Workers share the addresses of the process they are forked from. What somebody learns about them from one worker is of
use against the next, until there is a new process: after a worker crashed or lied, and now and then.
"""

import asyncio
import logging

from app.settings import Settings
from app.workers.wire import SandboxLimits
from app.workers.zygote_client import Card, Launch, StartError, Worker, ZygoteClient

logger = logging.getLogger("prsnet")


class Zygotes:
    """The process that workers are forked from now, which ``current`` is, and how there comes to be another.

    ``on_worker_end`` and ``on_end`` are called when a worker, and when the process itself, has ended.
    """

    def __init__(self, settings: Settings, launch: Launch) -> None:
        self.current: ZygoteClient | None = None
        self.card: Card | None = None
        self.forks = 0
        """Workers forked since the current one began to serve; the first ones are not counted."""

        self._settings = settings
        self._launch = launch
        self._since = 0.0
        self._revival = asyncio.Lock()
        self._closed = False

    def on_worker_end(self, worker: Worker) -> None:
        """Nobody has said what to do."""

    def on_end(self) -> None:
        """Nobody has said what to do."""

    @property
    def is_aged(self) -> bool:
        """Whether the addresses of the current one have been in use for long."""
        after = self._settings.renew_s
        return after > 0 and self.forks > 0 and asyncio.get_running_loop().time() - self._since >= after

    async def start(self) -> Card:
        """Start the first one.

        Raises:
            StartError: it does not load.
        """
        self.current = self._new()
        self.card = await self.current.start()
        return self.card

    async def spawn(self) -> Worker:
        """A new worker, of a new process if need be.

        Raises:
            OSError, EOFError, TimeoutError, wire.WireError, StartError: it did not come.
        """
        zygote = await self.living()
        self.forks += 1
        return await zygote.spawn()

    async def living(self) -> ZygoteClient:
        """The current one, or a new one if it has ended.

        Raises:
            StartError: there is none to be had.
        """
        async with self._revival:
            if self.current is not None and self.current.alive:
                return self.current
            if self.current is not None:
                await self.current.close()
            zygote = self.current = self._new()
            if await zygote.start() != self.card:
                await zygote.close()
                raise StartError("the weights have changed since the service started")
            return zygote

    async def succeed(self) -> ZygoteClient | None:
        """Replace the current one; returns it, that it may be closed, or None where there is no other to be had."""
        self._since = asyncio.get_running_loop().time()
        zygote, former = self._new(), None
        try:
            # Meanwhile the current one goes on forking.
            if await zygote.start() == self.card and not self._closed:
                former, self.current = self.current, zygote
        except StartError as error:
            logger.error("no new process to fork workers from: %s", error)
        finally:
            if former is None:
                await zygote.close()
        return former

    async def close(self) -> None:
        """End the current one, and let there be no other."""
        self._closed = True
        if self.current is not None:
            zygote, self.current = self.current, None
            await zygote.close()

    def _new(self) -> ZygoteClient:
        settings = self._settings
        self._since = asyncio.get_running_loop().time()
        limits = SandboxLimits(settings.worker_memory_bytes, settings.sandbox, settings.worker_nice)
        zygote = ZygoteClient(self._launch, limits)
        zygote.on_worker_end = self.on_worker_end
        zygote.on_end = self.on_end
        return zygote
