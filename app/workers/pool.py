"""Hands jobs to workers: so many at a time, so many waiting, spare workers ready for when others are replaced.

No worker serves two clients, unless a setting says that it may: what one of them left in its memory, or made of it,
another one's files do not meet. Spare workers have served nobody.
"""

import asyncio
import json
import logging
import math
import platform
import signal
from collections.abc import Callable, Coroutine
from contextlib import AbstractContextManager

from app.problems import OVERLOADED, ProblemError
from app.settings import Settings
from app.workers import sandbox, verify, wire
from app.workers.errors import DefectError, OutOfMemoryError, TookTooLongError, WorkerLostError
from app.workers.turns import Places, Turns
from app.workers.wire import Job
from app.workers.zygote_client import Card, Launch, StartError, Worker, ZygoteClient
from app.workers.zygotes import Zygotes

logger = logging.getLogger("prsnet")
_SHARE = 0.75  # of all places one client may have, unless a setting says how many
_WATCH_S = 1.0
_RENEW_S = 20.0
_CRASHES = (signal.SIGSEGV, signal.SIGBUS, signal.SIGILL, signal.SIGABRT, signal.SIGSYS, signal.SIGFPE)
_TRIES = 2
_REPORT_S = 0.5  # how long to wait for word on how a worker ended
_LOST = (EOFError, OSError)


class WorkerPool:
    """At most ``settings.workers`` jobs run and ``settings.queue`` more requests wait; the rest is refused."""

    def __init__(self, settings: Settings, launch: Launch) -> None:
        self.settings = settings
        capacity = settings.workers + settings.queue
        self.places = Places(capacity, settings.places_per_client or math.ceil(_SHARE * capacity))
        self.running = 0
        self.on_restart: Callable[[str], None] = lambda _: None
        # Where workers are replaced all the time, each that works has another one ready to follow it.
        self._spare = 1 if settings.isolation == "none" else settings.workers
        self._jobs = 1 if settings.isolation == "request" else settings.worker_jobs
        self._zygotes = Zygotes(settings, launch)
        self._zygotes.on_worker_end, self._zygotes.on_end = self._on_worker_end, self._on_zygote_end
        self._retiring: set[ZygoteClient] = set()
        self._is_exchanging = False
        self._turns = Turns(settings.workers)
        self._idle: list[Worker] = []
        self._live: set[Worker] = set()
        self._arrival = asyncio.Event()
        self._background_tasks: set[asyncio.Task[None]] = set()
        self._closed = False
        self._renewed, self._is_renewing = -_RENEW_S, False
        self.card: Card | None = None

    @property
    def admitted(self) -> int:
        """Requests that are worked on or wait for it."""
        return len(self.places)

    @property
    def live(self) -> int:
        """Workers that are there, the spare one included."""
        return len(self._live)

    async def start(self) -> Card:
        """Load the weights and start all workers.

        Raises:
            StartError: the weights do not load, or no worker starts.
        """
        if not self.settings.sandbox:
            logger.warning("PRSNET_SANDBOX=false: what a file makes a worker do, it can do with this user's rights")
        elif not sandbox.available():
            raise StartError(
                f"system calls cannot be filtered here ({platform.system()} on {platform.machine()}); "
                "PRSNET_SANDBOX=false serves without"
            )
        self.card = await self._zygotes.start()
        if self.card.threads > 1:
            logger.warning("workers are forked from a process with %d threads", self.card.threads)
        try:
            first = [self._zygotes.spawn() for _ in range(self.settings.workers + self._spare)]
            for worker in await asyncio.gather(*first):
                self._welcome(worker)
        except (*_LOST, TimeoutError, wire.WireError) as error:
            raise StartError(f"no worker starts: {error!r}") from error
        self._zygotes.forks = 0
        self._begin(self._watch())
        return self.card

    async def _watch(self) -> None:
        """Replace workers that are no use any more: stopped ones send no word. Their jobs are tried once more."""
        while True:
            await asyncio.sleep(_WATCH_S)
            for worker in list(self._live):
                if worker in self._idle:
                    if not worker.silent():
                        self._idle.remove(worker)
                        self._discard(worker, "lost")
                elif worker.is_stopped():
                    worker.end()
            if self._zygotes.is_aged and not self._is_exchanging:
                self._begin(self._exchange_zygote())

    def admit(self, client: str = "") -> AbstractContextManager[None]:
        """Admit a request; its place is free again as soon as the context ends.

        Raises:
            ProblemError: ``overloaded`` (503, with ``Retry-After``).
        """
        self.require_room(client)
        return self.places.one(client)

    def require_room(self, client: str = "") -> None:
        """Return if a request of this client would be admitted now.

        Raises:
            ProblemError: ``overloaded`` (503, with ``Retry-After``).
        """
        if not self.places.has_room(client):
            raise ProblemError(OVERLOADED, OVERLOADED.example, {"Retry-After": "1"})

    async def run(
        self, job: Job, data: bytes | int, on_turn: Callable[[], None] = lambda: None, client: str = ""
    ) -> verify.Answer:
        """The answer to a job about a file: its bytes, or a descriptor. When cancelled, the work ends at once.

        ``on_turn`` is called when the waiting is over. A worker that served another ``client`` is not used, unless a
        setting allows it.

        Raises:
            model.errors.MeshError: the worker reports it.
            WorkerLostError, TookTooLongError, OutOfMemoryError, DefectError: there is no answer, and why.
        """
        await self._turns.take(client)
        self.running += 1
        try:
            on_turn()
            for _ in range(_TRIES):
                worker = await self._take("" if self.settings.isolation == "none" else client)
                try:
                    return await self._run_job(worker, job, data)
                except _LOST:
                    await self._account_for(worker)
            raise WorkerLostError
        finally:
            self.running -= 1
            self._turns.give_back()

    async def close(self) -> None:
        """End all processes."""
        self._closed = True
        for task in self._background_tasks:
            task.cancel()
        if self._background_tasks:
            await asyncio.wait(self._background_tasks)
        for worker in list(self._live):
            worker.kill()
        self._live.clear()
        self._idle.clear()
        for zygote in self._retiring:
            await zygote.close()
        await self._zygotes.close()

    async def _run_job(self, worker: Worker, job: Job, data: bytes | int) -> verify.Answer:
        """One try. The worker is returned only if its answer was complete; otherwise it is killed."""
        keep, reason = False, "deadline"
        try:
            kind, payload = await self._exchange(worker, job, data)
            reason = "untrusted"
            if kind == wire.ANSWER:
                assert self.card is not None
                body = await self._body(worker, job)
                answer = await self._checked(payload, body, job, self.card)
                keep = True
                return answer
            if kind == wire.NO_MEMORY:
                reason = "memory"
                raise OutOfMemoryError
            if kind == wire.MESH_ERROR:
                error = verify.trusted_error(json.loads(payload))
                keep = True
                raise error
            if kind == wire.DEFECT:
                keep = True
                raise DefectError(f"in worker {worker.pid}:\n{json.loads(payload)}")
            raise wire.WireError("an unexpected frame")
        except (ValueError, verify.UntrustedError, wire.WireError) as error:
            self._renew()
            raise DefectError(f"worker {worker.pid} is not trusted any more: {error}") from error
        except TookTooLongError:
            reason = "deadline"
            raise
        except asyncio.CancelledError as error:
            reason = "client-left" if error.args == ("client-left",) else "deadline"
            raise
        except _LOST:
            reason = "lost"
            raise
        finally:
            if keep:
                self._give_back(worker)
            else:
                self._discard(worker, reason)

    async def _body(self, worker: Worker, job: Job) -> bytes | None:
        """The geometry that follows the answer, if it was asked for."""
        if job.geometry is None:
            return None
        kind, body = await wire.receive(worker.connection, job.max_answer_bytes)
        if kind != wire.GEOMETRY:
            raise wire.WireError("no geometry after the answer")
        return body

    async def _checked(self, payload: bytes, body: bytes | None, job: Job, card: Card) -> verify.Answer:
        if len(payload) + len(body or b"") < wire.SMALL:
            return verify.trusted(payload, body, job, card)
        return await asyncio.to_thread(verify.trusted, payload, body, job, card)

    async def _exchange(self, worker: Worker, job: Job, data: bytes | int) -> tuple[bytes, bytes]:
        seconds = self.settings.parse_s
        try:
            async with asyncio.timeout(seconds):
                await wire.send_job(worker.connection, job, data)
                kind, payload = await wire.receive(worker.connection)
        except TimeoutError as error:
            raise TookTooLongError(f"Reading the file took longer than the {seconds:g} seconds allowed.") from error
        if kind == wire.PARSED:
            return await wire.receive(worker.connection, verify.LARGEST_ANSWER)
        return kind, payload

    async def _account_for(self, worker: Worker) -> None:
        """Log how a lost worker ended, and tell a job that used up its processor time from an accident."""
        try:
            code = await asyncio.wait_for(asyncio.shield(worker.ended), _REPORT_S)
        except TimeoutError:
            logger.warning("worker %d was lost", worker.pid)
            return
        if -code in _CRASHES:
            self._renew()
        how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        logger.warning("worker %d was lost: %s", worker.pid, how)
        if code == -signal.SIGXCPU:
            raise TookTooLongError("The request used up the processor time a request may take.")

    async def _take(self, tenant: str) -> Worker:
        while True:
            while self._idle:
                # The last one used, of those that know this tenant; else of those that know nobody.
                known = [worker for worker in self._idle if worker.tenant == tenant]
                fitting = known or [worker for worker in self._idle if not worker.tenant]
                if not fitting:
                    self._make_room(0)
                    continue
                worker = fitting[-1]
                self._idle.remove(worker)
                if not worker.silent():
                    self._discard(worker, "lost")
                    continue
                worker.tenant = tenant
                self._make_room(self.settings.workers - self.running)
                return worker
            self._arrival.clear()
            await self._arrival.wait()

    def _make_room(self, most: int) -> None:
        """Replace idle workers that know a tenant, the longest idle first, until there are at most so many."""
        known = [worker for worker in self._idle if worker.tenant]
        for worker in known[: max(len(known) - most, 0)]:
            self._idle.remove(worker)
            self._discard(worker, "client")

    def _welcome(self, worker: Worker) -> None:
        self._live.add(worker)
        self._idle.append(worker)
        self._arrival.set()

    def _give_back(self, worker: Worker) -> None:
        worker.jobs += 1
        if worker.jobs >= self._jobs or worker.origin in self._retiring:
            self._discard(worker, "recycled" if worker.jobs >= self._jobs else "aged")
        elif worker in self._live:
            self._idle.append(worker)
            self._arrival.set()

    def _discard(self, worker: Worker, reason: str) -> None:
        """Kill a worker and order another one."""
        worker.kill()
        if worker not in self._live or self._closed:
            return
        self._live.discard(worker)
        self.on_restart(reason)
        self._begin(self._replace())

    def _on_worker_end(self, worker: Worker) -> None:
        if worker in self._idle:  # nobody else is there to notice
            self._idle.remove(worker)
            self._discard(worker, "lost")

    def _begin(self, work: Coroutine[None, None, None]) -> None:
        task = asyncio.create_task(work)
        self._background_tasks.add(task)
        task.add_done_callback(self._background_tasks.discard)

    async def _replace(self) -> None:
        """Get one more worker, however long it takes, with a new zygote if need be."""
        pause = 0.05
        while not self._closed:
            try:
                self._welcome(await self._zygotes.spawn())
                return
            except (*_LOST, TimeoutError, wire.WireError, StartError) as error:
                logger.error("no new worker: %r; trying again", error)
                await asyncio.sleep(pause)
                pause = min(2 * pause, 5.0)

    def _renew(self) -> None:
        """A worker may have been attacked: have the next ones forked from a new process, whose addresses are others.

        Not all the time, for it takes seconds of a core: so many in a minute.
        """
        if not self._closed and not self._is_renewing:
            self._is_renewing = True
            self._begin(self._renew_zygote(self._renewed + _RENEW_S - asyncio.get_running_loop().time()))

    async def _renew_zygote(self, pause: float) -> None:
        await asyncio.sleep(max(pause, 0.0))
        self._is_renewing, self._renewed = False, asyncio.get_running_loop().time()
        former = await self._zygotes.succeed()
        if former is None:
            return
        await former.close()
        for worker in list(self._idle):
            self._idle.remove(worker)
            self._discard(worker, "renewed")

    async def _exchange_zygote(self) -> None:
        """Have all workers forked from a new process, one after the other, while the old ones go on serving."""
        self._is_exchanging = True
        try:
            former = await self._zygotes.succeed()
            if former is None:
                return
            former.on_end = lambda: None
            self._retiring.add(former)
            await self._exchange_idle(former)
            self._zygotes.forks = 0
            while any(worker.origin is former for worker in self._live):
                await asyncio.sleep(_WATCH_S)
            await former.close()
            self._retiring.discard(former)
        finally:
            self._is_exchanging = False

    async def _exchange_idle(self, former: ZygoteClient) -> None:
        """Replace the idle workers of a former process, each when another one is there; those at work go when done."""
        for worker in [worker for worker in self._idle if worker.origin is former]:
            try:
                fresh = await self._zygotes.spawn()
            except (*_LOST, TimeoutError, wire.WireError, StartError) as error:
                logger.error("no new worker: %r", error)
                fresh = None
            if worker not in self._idle:
                if fresh is not None:
                    fresh.kill()
                continue
            self._idle.remove(worker)
            if fresh is None:
                self._discard(worker, "aged")
                continue
            worker.kill()
            self._live.discard(worker)
            self.on_restart("aged")
            self._welcome(fresh)

    async def _revive(self) -> None:
        """Have a zygote again before a worker is lost. If it cannot be had now, `_replace` will go on trying."""
        try:
            await self._zygotes.living()
        except StartError as error:
            logger.error("no new process to fork workers from: %s", error)

    def _on_zygote_end(self) -> None:
        """The workers go on, and so does the service; a new zygote is needed before the next one is lost."""
        if self._closed:
            return
        logger.error("the process that workers are forked from ended")
        self.on_restart("zygote")
        self._begin(self._revive())
