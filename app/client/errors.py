"""Why a client has no answer.

ClientError
├── UnreachableError         no connection, or it broke, or took too long
├── UnexpectedAnswerError    what answered is not this service, or of another version
└── ProblemAnswerError       the service says what is wrong (its ``problem``)
    ├── RequestError         the request: 400, 401, 404, 405, 406, 408, an upload too large
    ├── UnusableMeshError    the mesh: unreadable, empty, degenerate, too large, no plane
    └── UnavailableError     the service: overloaded, starting, a deadline passed, a defect
"""

from app.schemas import Problem

_MESH_SLUGS = frozenset(
    {"mesh-too-large", "unsupported-format", "unreadable-mesh", "empty-mesh", "degenerate-mesh", "no-plane"}
)


class ClientError(Exception):
    """Base of all errors of the client."""


class UnreachableError(ClientError):
    """No connection, or it broke, or took too long."""


class UnexpectedAnswerError(ClientError):
    """What answered is not this service, or of another version."""


class ProblemAnswerError(ClientError):
    """The service answered with a problem; the message is its ``detail``."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.detail)
        self.problem = problem

    @property
    def slug(self) -> str:
        """The last part of the problem's ``type``, such as ``unreadable-mesh``."""
        return self.problem.type.rsplit("/", 1)[-1]


class RequestError(ProblemAnswerError):
    """The request is at fault."""


class UnusableMeshError(ProblemAnswerError):
    """The mesh is at fault."""


class UnavailableError(ProblemAnswerError):
    """The service is at fault, and may be better later."""


def for_problem(problem: Problem) -> ProblemAnswerError:
    """The exception for a problem document."""
    if problem.status >= 500:
        return UnavailableError(problem)
    slug = problem.type.rsplit("/", 1)[-1]
    return UnusableMeshError(problem) if slug in _MESH_SLUGS else RequestError(problem)
