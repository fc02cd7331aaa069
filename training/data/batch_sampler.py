"""Which shapes a step sees: shuffled epochs, balanced over categories or sources, from one set or several.

A function of the recipe, the data and the step alone: runs can be resumed, and every process of a distributed run
draws the same whole batch and takes its own part of it.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from training.data.mixture import Mixture
from training.data.prepared import PreparedSet
from training.recipe import Recipe


@dataclass(frozen=True, slots=True)
class Group:
    """Shapes that share a quota: their ``name``, indices ``members`` ``(m,)`` and how many an epoch ``draws``."""

    name: str
    members: NDArray[np.int64]
    draws: int


class Sampler:
    """Draws the shapes of each step.

    An epoch holds a quota of every group. Within a group all shapes are gone through in random order before one comes
    again, across epochs too. The epoch is shuffled and cut into batches; the last, short one is left out. With
    ``recipe.sampling.shards`` the shards themselves are shuffled, and the shapes of so many at a time.
    """

    def __init__(self, prepared: PreparedSet, pool: NDArray[np.int64], recipe: Recipe) -> None:
        """Draw from the shapes ``pool`` ``(n,)`` of ``prepared``.

        Raises:
            ValueError: the pool is empty, or one of a mixture's sets has no shape in it.
        """
        self.groups = _groups(prepared, pool, recipe)
        self._seed = recipe.seed
        self._shards_at_a_time = recipe.sampling.shards
        self._shard_of = prepared.locations()[0]
        self._size = sum(group.draws for group in self.groups)
        self.batch = min(recipe.optimizer.batch, self._size)
        self._epoch = -1
        self._order: NDArray[np.int64] = np.zeros(0, dtype=np.int64)

    def draw(self, step: int) -> Tensor:
        """The shapes of a step, ``(batch,)`` int64 on the CPU."""
        epoch, within = divmod(step, self._size // self.batch)
        if epoch != self._epoch:
            picked = np.concatenate([self._picked(number, epoch) for number in range(len(self.groups))])
            self._order = self._shuffled(picked, np.random.default_rng([self._seed, epoch]))
            self._epoch = epoch
        return torch.from_numpy(self._order[within * self.batch : (within + 1) * self.batch])

    def _shuffled(self, picked: NDArray[np.int64], chance: np.random.Generator) -> NDArray[np.int64]:
        """The shapes of an epoch in the order they are drawn in."""
        picked = picked[chance.permutation(self._size)]
        if not self._shards_at_a_time:
            return picked
        place = chance.permutation(int(self._shard_of.max()) + 1)
        return picked[np.argsort(place[self._shard_of[picked]] // self._shards_at_a_time, kind="stable")]

    def _picked(self, number: int, epoch: int) -> NDArray[np.int64]:
        """What a group gives to an epoch, sorted: a piece of its endless row of shuffled passes."""
        group = self.groups[number]
        size = len(group.members)
        first, last = epoch * group.draws, (epoch + 1) * group.draws
        if size == group.draws:  # all of it, every time
            return group.members
        passes = [
            np.random.default_rng([self._seed, number, epoch]).permutation(size)
            for epoch in range(first // size, -(-last // size))
        ]
        start = first - first // size * size
        return np.sort(group.members[np.concatenate(passes)[start : start + group.draws]])


def _groups(prepared: PreparedSet, pool: NDArray[np.int64], recipe: Recipe) -> list[Group]:
    """Groups with their quotas, those of the main set first.

    The main set's epoch is as long as its pool, or ``per_category`` for each group; the others come on top of it as
    their shares say.
    """
    sampling = recipe.sampling
    parts = prepared.part_of if isinstance(prepared, Mixture) else np.zeros(len(prepared), dtype=np.int64)
    shares = prepared.shares if isinstance(prepared, Mixture) else (1.0,)
    found: list[Group] = []
    main = 0
    for part, share in enumerate(shares):
        own = pool[parts[pool] == part]
        if len(own) == 0:
            raise ValueError("the prepared set holds no shape to train on")
        names = np.array([_key(prepared, index, sampling.balance) for index in own.tolist()])
        kinds, sizes = np.unique(names, return_counts=True)
        if part == 0:
            main = sampling.per_category * len(kinds) if sampling.per_category else len(own)
        weights = sizes ** (1.0 - (1.0 if sampling.per_category else sampling.power))
        quotas = weights / weights.sum() * main * share / shares[0]
        for kind, quota in zip(kinds.tolist(), quotas.tolist(), strict=True):
            found.append(Group(kind, own[names == kind], max(1, round(quota))))
    return found


def _key(prepared: PreparedSet, index: int, balance: str) -> str:
    shape = prepared.shapes[index]
    if balance == "none":
        return ""
    return shape.category or shape.source if balance == "category" else shape.source
