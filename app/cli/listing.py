"""What ``prsnet detect`` says about many files: a table for people, or one of the formats for programs."""

import json
import sys
from collections.abc import Callable, Collection, Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from app.cli.batch import Outcome, named
from app.cli.tables import print_report
from app.outputs import bop, csv_rows
from app.schemas import DetectResponse, Include, to_json

Format: TypeAlias = Literal["table", "json", "jsonl", "csv", "bop"]


def format_of(path: Path) -> Format | None:
    """The format that a file's name asks for, if it does."""
    name = path.suffix[1:].lower()
    return next((format for format in get_args(Format) if format == name), None)


class Listing:
    """Takes outcomes and lists the answers: at once where the format allows it, at the end otherwise.

    ``keys`` are the names of entries by file, for a format that has them; ``file`` is where to write instead of to
    standard output.
    """

    def __init__(
        self,
        format: Format,
        *,
        many: bool,
        include: Collection[Include],
        keys: Mapping[Path, str],
        file: Path | None = None,
    ) -> None:
        self._format: Format = format
        self._many = many
        self._include = include
        self._keys = keys
        self._file = file
        self._kept: list[DetectResponse] = []
        self._entries: dict[str, Any] = {}
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(b"")  # what cannot be written is told before anything is computed

    @contextmanager
    def progress(self, count: int) -> Generator[Callable[[], None], None, None]:
        """A bar on standard error while there are several files and somebody looks; call what it gives after each."""
        console = Console(stderr=True)
        if count < 2 or not console.is_terminal:
            yield lambda: None
            return
        columns = (TextColumn("detecting"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        # Where results are printed in between, the bar would be in their way unless they pass through it.
        with Progress(*columns, console=console, transient=True, redirect_stdout=sys.stdout.isatty()) as bar:
            task = bar.add_task("", total=count)
            yield lambda: bar.advance(task)

    def add(self, outcome: Outcome) -> None:
        """One outcome; those without an answer are not listed here."""
        response = outcome.response
        if response is None:
            return
        if self._many:
            response = named(response, outcome.path)
        if self._format == "table":
            print_report(response)
        elif self._format == "jsonl":
            self._write(to_json(response, self._include) + b"\n")
        elif self._format == "bop":
            self._entries[self._keys[outcome.path]] = json.loads(bop.write(response))
        else:
            self._kept.append(response)

    def end(self) -> None:
        """List what waited for the last file."""
        if self._format == "json" and self._kept:
            texts = [to_json(response, self._include) for response in self._kept]
            self._write((b"[" + b",\n".join(texts) + b"]" if self._many else texts[0]) + b"\n")
        elif self._format == "json" and self._many:
            self._write(b"[]\n")
        elif self._format == "csv":
            self._write(csv_rows.write(self._kept))
        elif self._format == "bop":
            self._write(json.dumps(self._entries, indent=2).encode() + b"\n")

    def _write(self, text: bytes) -> None:
        if self._file is None:
            typer.echo(text.decode(), nl=False)
            return
        with self._file.open("ab") as file:
            file.write(text)
