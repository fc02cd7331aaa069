"""Answers given before, for files that are sent again: by the digest of what was sent and of what was asked.

What is kept has been checked as any answer (`app.workers.verify`). It is kept as bytes, so that its size is known, and
the oldest in use makes room. With keys each key sees its own alone: how fast an answer comes would tell what others
have sent.
"""

import hashlib
import json
from collections import OrderedDict
from dataclasses import dataclass

from app.workers.verify import Answer, Content

HEADER = "PRSNet-Cache"
"""``hit`` or ``miss``; not there when the cache is off."""

_SHARE = 4
_OVERHEAD = 500
"""Bytes of an entry beside its content, roughly."""


@dataclass(frozen=True, slots=True)
class _Entry:
    kind: type[Content]
    text: bytes
    file: tuple[bytes, ...]

    @property
    def size(self) -> int:
        return len(self.text) + sum(map(len, self.file)) + _OVERHEAD


class AnswerCache:
    """At most ``limit`` bytes of answers, of which none has more than a quarter; with 0 it keeps nothing."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._entries: OrderedDict[str, _Entry] = OrderedDict()
        self.size = 0
        self.hits = 0
        self.misses = 0

    @property
    def enabled(self) -> bool:
        """Whether it keeps anything."""
        return self._limit > 0

    def __len__(self) -> int:
        return len(self._entries)

    def get(self, key: str) -> Answer | None:
        """The answer that was kept under a key."""
        entry = self._entries.get(key)
        if entry is None:
            self.misses += 1
            return None
        self.hits += 1
        self._entries.move_to_end(key)
        return Answer(entry.kind.model_validate_json(entry.text), list(entry.file))

    def clear(self) -> None:
        """Forget everything."""
        self._entries.clear()
        self.size = 0

    def put(self, key: str, answer: Answer) -> None:
        """Keep an answer, unless it is too large."""
        entry = _Entry(type(answer.content), answer.content.model_dump_json(by_alias=True).encode(), tuple(answer.file))
        if entry.size > self._limit // _SHARE:
            return
        if former := self._entries.pop(key, None):
            self.size -= former.size
        self._entries[key] = entry
        self.size += entry.size
        while self.size > self._limit:
            self.size -= self._entries.popitem(last=False)[1].size


def digest(*parts: object) -> str:
    """The digest of a question: anything that JSON can say."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def matches(etag: str, condition: str | None) -> bool:
    """Whether the header If-None-Match names an entity tag; compared weakly, ``*`` names none."""
    tags = (condition or "").split(",")
    return etag.removeprefix("W/") in {tag.strip().removeprefix("W/") for tag in tags}
