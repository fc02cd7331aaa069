"""Who gets a slot for an upload, and who loses one."""

import pytest

from app.http.slots import UploadSlot, UploadSlots

pytestmark = pytest.mark.anyio


def taken(slots: UploadSlots, address: str) -> UploadSlot:
    slot = slots.take(address)
    assert slot is not None
    return slot


def aged(slot: UploadSlot, received: int, seconds: float = 10.0) -> UploadSlot:
    slot.began -= seconds
    slot.received = received
    return slot


async def test_an_address_has_so_many_and_all_together_so_many() -> None:
    slots = UploadSlots(6, 4, 1000)
    mine = [taken(slots, "a") for _ in range(4)]
    assert slots.take("a") is None
    assert not slots.has_room("a")
    others = [taken(slots, "b") for _ in range(2)]
    assert slots.take("c") is None
    slots.leave(mine[0])
    assert slots.has_room("c")
    assert len(slots) == 5
    assert others


async def test_the_slowest_upload_makes_room_and_is_told() -> None:
    slots, told = UploadSlots(3, 3, 1000), list[str]()
    for name, received in (("fast", 10**6), ("slow", 5000), ("slowest", 10)):
        aged(taken(slots, name), received).on_eviction = lambda name=name: told.append(name)
    assert taken(slots, "new")
    assert told == ["slowest"]
    assert taken(slots, "newer")
    assert told == ["slowest", "slow"]
    assert slots.take("newest") is None  # those that are left are fast, or young


async def test_who_has_all_they_may_clears_their_own() -> None:
    slots, told = UploadSlots(10, 2, 1000), list[str]()
    for name, received in (("other", 0), ("mine", 10), ("mine", 20)):
        aged(taken(slots, name), received).on_eviction = lambda label=f"{name}{received}": told.append(label)
    assert taken(slots, "mine")
    assert told == ["mine10"]
