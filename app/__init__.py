"""The HTTP service, its client, and the command line around the ``model`` package.

``http`` serves, ``workers`` run ``detection`` in processes of their own, ``outputs`` writes answers, ``cli`` and
``client`` are what people and programs use.

What programs use is here, loaded on first use: `detect`, `complete`, `halve`, `sector` and `align` in this process,
`Client` and `AsyncClient` with a running service, and the errors that clients raise.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from model import __version__ as __version__

if TYPE_CHECKING:
    from app.client.client import AsyncClient, Client
    from app.client.errors import (
        ClientError,
        ProblemAnswerError,
        RequestError,
        UnavailableError,
        UnexpectedAnswerError,
        UnreachableError,
        UnusableMeshError,
    )
    from app.local import align, complete, detect, halve, sector
    from app.schemas import DetectResponse

_HOMES = {
    "AsyncClient": "client.client",
    "Client": "client.client",
    "ClientError": "client.errors",
    "DetectResponse": "schemas",
    "ProblemAnswerError": "client.errors",
    "RequestError": "client.errors",
    "UnavailableError": "client.errors",
    "UnexpectedAnswerError": "client.errors",
    "UnreachableError": "client.errors",
    "UnusableMeshError": "client.errors",
    "align": "local",
    "complete": "local",
    "detect": "local",
    "halve": "local",
    "sector": "local",
}

__all__ = [
    "AsyncClient",
    "Client",
    "ClientError",
    "DetectResponse",
    "ProblemAnswerError",
    "RequestError",
    "UnavailableError",
    "UnexpectedAnswerError",
    "UnreachableError",
    "UnusableMeshError",
    "align",
    "complete",
    "detect",
    "halve",
    "sector",
]


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'app' has no attribute {name!r}")
    return getattr(import_module(f"app.{_HOMES[name]}"), name)
