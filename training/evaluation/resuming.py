"""Records on disk as soon as they are made, so that an evaluation that was interrupted goes on where it stopped.

A record holds the answers of several methods, and every answer says under `OF` what gave it. So a call may ask for
methods that an earlier one did not have, for fewer, or for some of them once more: only what is missing is judged.
"""

import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

OF = "of"
"""Of an answer: the ``revision`` of the code that gave it, and the ``weights`` where they are a file's."""


class Kept:
    """The records of an evaluation by ``name``: those of earlier calls, and those of this one."""

    def __init__(
        self,
        file: Path | None,
        options: Mapping[str, Any],
        methods: Mapping[str, Mapping[str, str]],
        renew: Collection[str] = (),
    ) -> None:
        """Read what an earlier call left.

        Args:
            file: made if it is not there, begun anew if it is of other options, as its first line says; None: nothing
                is kept on disk.
            options: of this call, plain values; its methods are no part of them.
            methods: that this call asks for, by name, each with what its answers will say under `OF`. Earlier answers
                of other weights do not count; those of another revision do.
            renew: of these methods earlier answers of another revision do not count either.

        Raises:
            ValueError: ``renew`` names a method that is not asked for.
        """
        if set(renew) - set(methods):
            raise ValueError(
                f"no method {', '.join(sorted(set(renew) - set(methods)))} is asked for that could be renewed"
            )
        self._file, self._methods, self._renew = file, methods, renew
        self._records: dict[str, dict[str, Any]] = {}
        head = json.dumps({"options": {key: value for key, value in options.items() if key != "methods"}})
        if file is None:
            return
        lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
        for line in lines[1:] if lines and lines[0] == head else []:
            try:
                record = json.loads(line)
            except json.JSONDecodeError:  # cut off while it was written
                continue
            self._records[record["name"]] = record
        whole = [head, *map(json.dumps, self._records.values())]
        file.write_text("\n".join(whole) + "\n", encoding="utf-8")

    def missing(self, name: str) -> tuple[str, ...]:
        """The methods whose answer to the shape ``name`` is still to be had; none of a shape that could not be read."""
        record = self._records.get(name, {"methods": {}})
        if "methods" not in record:
            return ()
        return tuple(method for method in self._methods if not self._counts(method, record["methods"].get(method)))

    def _counts(self, method: str, answer: Mapping[str, Any] | None) -> bool:
        if answer is None:
            return False
        of, wanted = answer[OF], self._methods[method]
        return of.get("weights") == wanted.get("weights") and (
            method not in self._renew or of["revision"] == wanted["revision"]
        )

    def add(self, record: Mapping[str, Any]) -> None:
        """Keep a record; answers of other methods to the same shape stay."""
        merged = dict(record)
        if "methods" in merged:
            answers = {
                method: answer | {OF: self._methods[method]} if method in self._methods else answer
                for method, answer in merged["methods"].items()
            }
            merged["methods"] = self._records.get(record["name"], {"methods": {}}).get("methods", {}) | answers
        self._records[record["name"]] = merged
        if self._file is not None:
            with self._file.open("a", encoding="utf-8") as lines:
                lines.write(json.dumps(merged) + "\n")

    def listed(self, names: Collection[str], others: Sequence[str] = ()) -> list[dict[str, Any]]:
        """The records of these names, sorted, with the answers this call asked for, and those of ``others``."""
        found: list[dict[str, Any]] = []
        for name in sorted(set(names) & set(self._records)):
            record = dict(self._records[name])
            if "methods" in record:
                answers = record["methods"]
                record["methods"] = {of: answers[of] for of in (*self._methods, *others) if of in answers}
            found.append(record)
        return found


def revisions(records: Sequence[Mapping[str, Any]]) -> dict[str, list[str]]:
    """At which revisions of the code the answers in ``records`` were given: titles of methods by revision."""
    found: dict[str, dict[str, None]] = {}
    for record in records:
        for answer in record.get("methods", {}).values():
            if OF in answer:
                found.setdefault(answer[OF]["revision"], {})[answer["title"]] = None
    return {revision: list(titles) for revision, titles in found.items()}
