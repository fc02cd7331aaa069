"""What ``prsnet detect`` prints about many files: a table for people, or one of the formats for programs."""

import json
import sys
from collections.abc import Callable, Collection, Generator
from contextlib import contextmanager
from typing import Any, Literal, TypeAlias

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from app.cli.batch import Outcome, bop_key, named
from app.cli.tables import print_report
from app.outputs import bop, csv_rows
from app.schemas import DetectResponse, Include, to_json

Format: TypeAlias = Literal["table", "json", "jsonl", "csv", "bop"]


class Listing:
    """Takes outcomes and prints the answers: at once where the format allows it, at the end otherwise."""

    def __init__(self, format: Format, *, many: bool, include: Collection[Include]) -> None:
        self._format: Format = format
        self._many = many
        self._include = include
        self._kept: list[DetectResponse] = []
        self._entries: dict[str, Any] = {}

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
        """One outcome; those without an answer are not printed here."""
        response = outcome.response
        if response is None:
            return
        if self._many:
            response = named(response, outcome.path)
        if self._format == "table":
            print_report(response)
        elif self._format == "jsonl":
            typer.echo(to_json(response, self._include))
        elif self._format == "bop":
            self._entries[bop_key(outcome.path)] = json.loads(bop.write(response))
        else:
            self._kept.append(response)

    def end(self) -> None:
        """Print what waited for the last file."""
        if self._format == "json" and self._kept:
            texts = [to_json(response, self._include).decode() for response in self._kept]
            typer.echo("[" + ",\n".join(texts) + "]" if self._many else texts[0])
        elif self._format == "json" and self._many:
            typer.echo("[]")
        elif self._format == "csv":
            typer.echo(csv_rows.write(self._kept), nl=False)
        elif self._format == "bop":
            typer.echo(json.dumps(self._entries, indent=2))
