"""Whose a run's folder is: of one recipe, one set of data and one start; more steps may be added."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from training.recipe import Recipe
from training.trainer.revision import git_revision

_STEPS = "recipe.optimizer.steps"
_MOST_NAMED = 5


def claim(run: Path, record: Mapping[str, Any]) -> str | None:
    """Make a folder that of a run, or find that it is.

    A run that differs in nothing but a larger number of steps is extended: its record then has the new number.

    Args:
        run: the folder; made where there is none.
        record: ``recipe``, ``data`` and, where the run begins with given weights, ``start``.

    Returns:
        what to say if the run was extended.

    Raises:
        ValueError: the folder is another run's; the message names what differs.
    """
    identity = json.dumps(record, indent=1, sort_keys=True)
    stamp = run / "run.json"
    run.mkdir(parents=True, exist_ok=True)
    if not stamp.is_file():
        stamp.write_text(identity)
        (run / "revision").write_text(git_revision())
        return None
    begun, now = _fields(json.loads(stamp.read_text())), _fields(json.loads(identity))
    different = sorted(name for name in begun.keys() | now.keys() if begun.get(name) != now.get(name))
    if not different:
        return None
    before, after = begun.get(_STEPS), now.get(_STEPS)
    if different == [_STEPS] and isinstance(before, int) and isinstance(after, int) and after > before:
        stamp.write_text(identity)
        return f"extended from {before} to {after} steps; the learning rate goes on as planned for {after}"
    named = "; ".join(
        f"{name} is {_word(begun, name)} there and {_word(now, name)} here" for name in different[:_MOST_NAMED]
    )
    more = f"; and {len(different) - _MOST_NAMED} more" if len(different) > _MOST_NAMED else ""
    hint = " (steps can be added to a run, not taken away)" if different == [_STEPS] else ""
    raise ValueError(
        f"{run} holds a run of another recipe or other data, or from another start: {named}{more}{hint}. "
        "Give the same, or choose another folder"
    )


def _fields(record: dict[str, Any]) -> dict[str, Any]:
    """Every value of a record by its path; a recipe written before a field existed has its default."""
    try:
        recipe = json.loads(json.dumps(Recipe.from_dict(record["recipe"]).to_dict()))
    except ValueError:  # a field that is no more
        recipe = record["recipe"]
    return dict(_leaves({**record, "recipe": recipe}, ""))


def _leaves(value: Any, path: str) -> list[tuple[str, Any]]:
    if isinstance(value, dict) and value:
        return [leaf for key, inner in value.items() for leaf in _leaves(inner, f"{path}.{key}" if path else str(key))]
    return [(path, value)]


def _word(fields: Mapping[str, Any], name: str) -> str:
    text = json.dumps(fields[name]) if name in fields else "nothing"
    return text if len(text) <= 40 else f"{text[:37]}..."
