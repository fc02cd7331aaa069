"""Slots for uploads. A slow one holds its slot only as long as nobody else wants it."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field

_YOUNG_S = 1.0


@dataclass(eq=False, slots=True)
class UploadSlot:
    """An upload in progress; ``on_eviction`` is called when its slot is given to another."""

    address: str
    began: float = field(default_factory=lambda: asyncio.get_running_loop().time())
    received: int = 0
    on_eviction: Callable[[], None] | None = None


class UploadSlots:
    """At most ``most`` uploads at a time, ``of_one`` of any one address, and slow ones make room for others.

    Slow is what brings less than ``bytes_per_s`` on average, after its first second.
    """

    def __init__(self, most: int, of_one: int, bytes_per_s: int) -> None:
        self._most, self._of_one, self._bytes_per_s = most, of_one, bytes_per_s
        self._taken: set[UploadSlot] = set()

    def __len__(self) -> int:
        return len(self._taken)

    def has_room(self, address: str) -> bool:
        """Whether `take` would give a slot now."""
        room, victim = self._look(address)
        return room or victim is not None

    def take(self, address: str) -> UploadSlot | None:
        """A slot, for which a slow upload may have to go; None if there is none."""
        room, victim = self._look(address)
        if not room:
            if victim is None:
                return None
            if victim.on_eviction is not None:
                victim.on_eviction()
            self._taken.discard(victim)
        slot = UploadSlot(address)
        self._taken.add(slot)
        return slot

    def leave(self, slot: UploadSlot) -> None:
        """The upload is over."""
        self._taken.discard(slot)

    def _look(self, address: str) -> tuple[bool, UploadSlot | None]:
        """Whether there is a free slot, and if not the slowest upload that may be sent away."""
        if len(self._taken) < min(self._most, self._of_one):
            return True, None
        mine = [slot for slot in self._taken if slot.address == address]
        if len(self._taken) < self._most and len(mine) < self._of_one:
            return True, None
        now = asyncio.get_running_loop().time()
        # Whoever has all they may have clears a slot of their own.
        rivals = mine if len(mine) >= self._of_one else self._taken
        slow = [(slot.received / (now - slot.began), slot) for slot in rivals if now - slot.began > _YOUNG_S]
        rate, slowest = min(slow, key=lambda entry: entry[0], default=(float("inf"), None))
        return False, slowest if rate < self._bytes_per_s else None
