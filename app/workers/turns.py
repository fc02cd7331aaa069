"""Whose turn it is: so many at a time, and of those who wait one of each client after the other."""

import asyncio
from collections import Counter, deque
from collections.abc import Generator
from contextlib import contextmanager


class Turns:
    """A semaphore that is fair to clients: who has one request waits for no other client's second."""

    def __init__(self, at_a_time: int) -> None:
        self._free = at_a_time
        self._waiting: dict[str, deque[asyncio.Future[None]]] = {}  # in the order in which clients have their turn

    async def take(self, client: str) -> None:
        """Wait for a turn, which is over when `give_back` is called."""
        if self._free:
            self._free -= 1
            return
        future: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._waiting.setdefault(client, deque()).append(future)
        try:
            await future
        except asyncio.CancelledError:
            if future.done() and not future.cancelled():
                self.give_back()  # it came at the same moment
            raise

    def give_back(self) -> None:
        """A turn is over: somebody else's begins."""
        while self._waiting:
            client = next(iter(self._waiting))
            queue = self._waiting.pop(client)
            future = queue.popleft()
            if queue:
                self._waiting[client] = queue  # behind all others
            if not future.done():  # else who waited has left
                future.set_result(None)
                return
        self._free += 1


class Places:
    """So many requests at a time, waiting ones among them, and ``of_one`` client's."""

    def __init__(self, most: int, of_one: int) -> None:
        self.most, self.of_one = most, of_one
        self._of: Counter[str] = Counter()

    def __len__(self) -> int:
        return self._of.total()

    def has_room(self, client: str, coming: Counter[str] | None = None) -> bool:
        """Whether there is a place for one more of this client's, when all that are ``coming`` have one."""
        coming = coming or Counter[str]()
        fits = len(self) + coming.total() < self.most
        return fits and self._of[client] + coming[client] < self.of_one

    @contextmanager
    def one(self, client: str) -> Generator[None]:
        """Have a place as long as the context lasts."""
        self._of[client] += 1
        try:
            yield
        finally:
            self._of[client] -= 1
            if not self._of[client]:
                del self._of[client]
