"""Turns go round among clients, and no client takes all places."""

import asyncio
from collections import Counter

import pytest

from app.workers.turns import Places, Turns

pytestmark = pytest.mark.anyio


async def test_who_comes_once_waits_for_nobodys_second() -> None:
    turns, order = Turns(1), list[str]()

    async def work(name: str) -> None:
        await turns.take(name[0])
        order.append(name)
        await asyncio.sleep(0)
        turns.give_back()

    names = ["a1", "a2", "a3", "a4", "b1", "b2", "c1"]
    await asyncio.gather(*map(work, names))
    assert order == ["a1", "a2", "b1", "c1", "a3", "b2", "a4"]
    await asyncio.gather(work("d1"), work("d2"))
    assert order[-2:] == ["d1", "d2"]


@pytest.mark.parametrize("moment", ["waiting", "called"])
async def test_who_leaves_loses_nobody_a_turn(moment: str) -> None:
    turns = Turns(2)
    await turns.take("a")
    await turns.take("a")
    left, stays = (asyncio.create_task(turns.take(name)) for name in ("b", "c"))
    await asyncio.sleep(0)
    if moment == "called":
        turns.give_back()
    left.cancel()
    if moment == "waiting":
        turns.give_back()
    await asyncio.wait_for(stays, 1)
    assert left.cancelled()
    for _ in range(2):
        turns.give_back()
    for _ in range(2):  # both are free again
        await asyncio.wait_for(turns.take("d"), 1)
    with pytest.raises(TimeoutError):
        await asyncio.wait_for(turns.take("d"), 0.01)


def test_one_client_leaves_places_for_others() -> None:
    places = Places(4, 3)
    held = [places.one("a") for _ in range(3)]
    for one in held:
        assert places.has_room("a")
        one.__enter__()
    assert not places.has_room("a")
    assert places.has_room("b")
    assert not places.has_room("b", Counter({"c": 1}))
    with places.one("b"):
        assert len(places) == 4
        assert not places.has_room("c")
    held[0].__exit__(None, None, None)
    assert places.has_room("a")
    assert not places.has_room("a", Counter({"a": 1}))
