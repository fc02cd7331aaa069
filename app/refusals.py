"""Options that are refused, in words: what is wrong with each, and what was probably meant."""

import difflib
import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

_QUOTED = re.compile(r"'([^']*)'")


Q = TypeVar("Q", bound=BaseModel)


def require(query: type[Q], **given: Any) -> Q:
    """Options as the service understands them.

    Raises:
        ValueError: the service would refuse them; names each and says why, with the likely word where there is one.
    """
    try:
        return query.model_validate(given)
    except ValidationError as error:
        faults = [f"{'.'.join(map(str, item['loc']))}: {reason(item, query.model_fields)}" for item in error.errors()]
        raise ValueError("; ".join(faults) + ".") from None


def reason(fault: Mapping[str, Any], names: Collection[str]) -> str:
    """What is wrong with one option; ``names`` are those there are. What was given is not repeated."""
    if fault["type"] == "extra_forbidden":
        return f"There is no such option{_nearest(str(fault['loc'][-1]), names)}"
    if fault["type"] == "literal_error":
        return f"{fault['msg']}{_nearest(str(fault['input']), _QUOTED.findall(fault['ctx']['expected']))}"
    return str(fault["msg"])


def _nearest(word: str, known: Collection[str]) -> str:
    """The known word that is most like another, if one is, as the end of a sentence."""
    by_folded = {name.lower(): name for name in known}
    found: Sequence[str] = difflib.get_close_matches(word.lower()[:40], by_folded, n=1)
    return f", probably {by_folded[found[0]]} is meant" if found else ""
