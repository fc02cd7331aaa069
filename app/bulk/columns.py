"""An answer as a row of a table: the columns are those of the HTTP service's JSON, after a few of their own.

Types are derived from the schemas, so that a member added there is a column here. A mesh without an answer has the
columns ``problem`` (the last part of the service's problem type) and ``detail``, and nulls in those of the answer.
"""

import hashlib
import types
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from app.bulk.libraries import pa
from app.schemas import DetectResponse

_LEFT_OUT = frozenset({"rejected", "bop"})  # only in answers that were asked for them
_SCALARS: dict[Any, Any] = {float: pa.float64(), int: pa.int64(), str: pa.string(), bool: pa.bool_()}

OWN: dict[str, Any] = {
    "path": pa.string(),  # of a member of a shard: the shard's, a slash, the member's
    "shard": pa.string(),  # null for a file of its own
    "bytes": pa.int64(),
    "sha256": pa.string(),  # of the file; null where it was not read
    "problem": pa.string(),  # null: there is an answer
    "detail": pa.string(),
    "read_ms": pa.float64(),
    "worker_ms": pa.float64(),  # what the answer, or the lack of one, took in a worker process
}


@cache
def schema() -> Any:
    """The Arrow schema of a result file."""
    fields = [pa.field(name, kind) for name, kind in OWN.items()]
    return pa.schema([*fields, *_fields(DetectResponse, _LEFT_OUT)])


def fingerprint() -> str:
    """Changes when the columns do."""
    return hashlib.sha256(str(schema()).encode()).hexdigest()[:16]


def table(rows: Iterable[Mapping[str, Any]]) -> Any:
    """Rows as an Arrow table; what a row does not name is null."""
    return pa.Table.from_pylist(list(rows), schema=schema())


def answered(response: DetectResponse) -> dict[str, Any]:
    """The columns that hold an answer."""
    return response.model_dump(exclude=set(_LEFT_OUT), by_alias=True)


def _fields(model: type[BaseModel], left_out: frozenset[str] = frozenset()) -> list[Any]:
    members = model.model_fields.items()
    return [
        pa.field(field.alias or name, arrow_type(field.annotation)) for name, field in members if name not in left_out
    ]


def arrow_type(annotation: Any) -> Any:
    """The Arrow type that holds values of a schema's member.

    Raises:
        TypeError: no type does.
    """
    if annotation in _SCALARS:
        return _SCALARS[annotation]
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return pa.struct(_fields(annotation))
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return arrow_type(arguments[0])
    if origin is Literal:
        return arrow_type(type(arguments[0]))
    if origin in (Union, types.UnionType):
        kinds = [kind for kind in arguments if kind is not types.NoneType]
        if len(kinds) == 1:
            return arrow_type(kinds[0])
        if all(isinstance(kind, type) and issubclass(kind, BaseModel) for kind in kinds):
            return _any_of(kinds)
    if origin in (list, tuple):
        return pa.list_(arrow_type(arguments[0]))
    if origin is dict:
        return pa.map_(arrow_type(arguments[0]), arrow_type(arguments[1]))
    raise TypeError(f"no column holds {annotation!r}")


def _any_of(models: list[type[BaseModel]]) -> Any:
    """A struct with the members of all models; those of another model are null."""
    members: dict[str, Any] = {}
    for model in models:
        for field in _fields(model):
            if members.setdefault(field.name, field).type != field.type:
                raise TypeError(f"no column holds both kinds of {field.name}")
    return pa.struct(list(members.values()))
