"""Who is let in: refusals that cost microseconds, given before a request is made of what came.

They say what the framework would say (`app.problems`); that it need not be asked is what keeps the service at its
capacity while ten times as much is offered.
"""

import asyncio
import hashlib
import hmac
import json
import logging
import os
from collections import Counter
from collections.abc import Sequence
from http import HTTPStatus

from app import problems
from app.http.metrics import Metrics
from app.http.middleware import HEADER, SANE_ID, SECURITY
from app.http.slots import UploadSlots
from app.problems import ProblemType
from app.schemas import KEY_HEADER
from app.settings import Settings
from app.workers.pool import WorkerPool

logger = logging.getLogger("prsnet.access")

_GUARDED = (b"/detect", b"/complete", b"/halve", b"/sector", b"/align")
_ID_NAME = HEADER.lower()
_KEY, _ID = KEY_HEADER.lower().encode(), _ID_NAME.encode()
_ID_HERE = "(id)"
_ARRIVING_S = 0.25
_LOG_EVERY_S = 1.0
Headers = Sequence[tuple[bytes, bytes]]
"""Names in lower case."""


class Refusal:
    """Why a request is not let in, and what is answered: written once, for only the request's id differs."""

    def __init__(self, problem: ProblemType, field: str) -> None:
        self.slug, self.status = problem.slug, problem.status
        fields = {"content-type": problems.MEDIA_TYPE, **{name.lower(): value for name, value in SECURITY.items()}}
        lines = [f"HTTP/1.1 {problem.status} {HTTPStatus(problem.status).phrase}", field]
        self._head = "\r\n".join([*lines, *(f"{name}: {value}" for name, value in fields.items())])
        self._content = json.dumps(problems.body(problem, problem.example, _ID_HERE)).split(_ID_HERE)

    def answer(self, request_id: str, *, keep: bool) -> bytes:
        """All of it; ``keep``: the connection stays open."""
        content = request_id.join(self._content)
        end = "\r\n\r\n" if keep else "\r\nconnection: close\r\n\r\n"
        length = f"content-length: {len(content)}"  # in bytes: JSON is ASCII, and so are the ids that are let through
        return f"{self._head}\r\n{_ID_NAME}: {request_id}\r\n{length}{end}{content}".encode()


_UNAUTHORIZED = Refusal(problems.UNAUTHORIZED, "www-authenticate: Bearer")
_OVERLOADED = Refusal(problems.OVERLOADED, "retry-after: 1")
_UPLOADS_FULL = Refusal(problems.UPLOADS_FULL, "retry-after: 1")


class Arrival:
    """A request that was let in and has no place yet. It counts as one in the queue, but for a moment only."""

    def __init__(self, gate: "Gate", client: str) -> None:
        self._gate, self._client = gate, client
        self._is_counted = True
        gate.arriving[client] += 1
        self._timer = asyncio.get_running_loop().call_later(_ARRIVING_S, self.end)

    def end(self) -> None:
        """It has a place, or needs none, or is too slow to be reckoned with."""
        if self._is_counted:
            self._is_counted = False
            self._gate.arriving -= Counter({self._client: 1})
            self._timer.cancel()


class Gate:
    """What one server lets in; all of its connections ask it."""

    def __init__(self, settings: Settings, pool: WorkerPool, metrics: Metrics) -> None:
        self.arriving = Counter[str]()
        self.slots = UploadSlots(settings.uploads, settings.uploads_per_address, settings.upload_bytes_per_s)
        self._settings = settings
        self._key_digests = [hashlib.sha256(key.encode()).digest() for key in settings.keys]
        self._address_header = settings.client_address_header.lower().encode()
        self._pool = pool
        self._metrics = metrics
        self._refused: Counter[str] = Counter()

    def knows(self, headers: Headers) -> bool:
        """Whether no keys are configured, or the headers hold one of them."""
        if not self._key_digests:
            return True
        # Digests are of one length, and every key is compared: the time taken tells nothing about any of them.
        digest = hashlib.sha256(self._given(headers)).digest()
        matches = [hmac.compare_digest(digest, key) for key in self._key_digests]
        return any(matches)

    def client(self, headers: Headers, peer: str) -> str:
        """Who has a share of the queue and shares no worker with others: a key, or without keys an address."""
        if not self._key_digests:
            return self.address(headers, peer) or "-"
        return hashlib.sha256(self._given(headers)).hexdigest()

    def owner(self, headers: Headers, peer: str) -> str:
        """Whose answers are kept apart from others': a client's, unless there are no keys and workers are shared."""
        shared = self._settings.isolation == "none" and not self._key_digests
        return "" if shared else self.client(headers, peer)

    def address(self, headers: Headers, peer: str) -> str:
        """Whose request it is: the peer's, or what the proxy in front says, where a setting trusts its header."""
        if not self._address_header:
            return peer
        said = [value for name, value in headers if name == self._address_header]
        return said[-1].rsplit(b",", 1)[-1].strip()[:64].decode("latin-1") if said else peer

    def guards(self, method: bytes, path: bytes) -> bool:
        """Whether a request asks for work."""
        return method == b"POST" and path.endswith(_GUARDED)

    def refusal(self, method: bytes, path: bytes, headers: Headers, peer: str) -> Refusal | None:
        """Why a request for work is not let in; None where the framework shall answer."""
        if not self.guards(method, path):
            return None
        if self._pool.card is None or (self._settings.cors_origins and any(name == b"origin" for name, _ in headers)):
            return None  # it knows better how to say it
        if not self.knows(headers):
            return _UNAUTHORIZED
        if not self._pool.places.has_room(self.client(headers, peer), self.arriving):
            return _OVERLOADED
        if not self.slots.has_room(self.address(headers, peer)):
            return _UPLOADS_FULL
        return None

    @property
    def has_reserve(self) -> bool:
        """Whether so many requests wait that no worker will be idle for the next milliseconds."""
        return self._pool.admitted - self._pool.running >= self._settings.workers

    def answer(self, refusal: Refusal, path: bytes, headers: Headers, *, keep: bool) -> bytes:
        """The whole answer to a request that is refused, which is counted; ``keep``: the connection stays open."""
        claimed = next((value.decode("latin-1") for name, value in headers if name == _ID), "")
        request_id = claimed if SANE_ID.fullmatch(claimed) else os.urandom(16).hex()
        route = "/" + path.decode("ascii", "replace").rsplit("/", 1)[-1]
        self._metrics.observe_request(route, "POST", refusal.status, 0.0, refusal.slug)
        self._note(refusal.slug)
        return refusal.answer(request_id, keep=keep)

    def _given(self, headers: Headers) -> bytes:
        """The key that a request brings."""
        given, token = b"", b""
        for name, value in headers:
            if name == _KEY:
                given = value
            elif name == b"authorization":
                scheme, _, rest = value.partition(b" ")
                token = rest.strip() if scheme.lower() == b"bearer" else b""
        return given or token

    def _note(self, slug: str) -> None:
        """One line of the log a second for all that were refused: a line each would cost more than the refusal."""
        if not self._refused:
            asyncio.get_running_loop().call_later(_LOG_EVERY_S, self._log)
        self._refused[slug] += 1

    def _log(self) -> None:
        for slug, count in self._refused.items():
            fields = {"problem": slug, "count": count, "seconds": _LOG_EVERY_S}
            logger.info("%d requests refused: %s", count, slug, extra={"fields": fields})
        self._refused.clear()
