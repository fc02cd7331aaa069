"""What ``prsnet detect`` prints about many files: a table for people, or one of the formats for programs."""

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from app.cli.batch import Outcome, named
from app.cli.tables import print_report
from app.outputs.output_format import Options, OutputFormat
from app.outputs.registry import DETECT_OUTPUTS
from app.schemas import DetectResponse, Include, to_json

TABLE, LINES = "table", "jsonl"
"""Formats of the command line alone: for people, and JSON with an answer a line."""


def output_for(format: str, *, many: bool) -> OutputFormat | None:
    """The record of a format that can be printed; None for the command line's own.

    Raises:
        ValueError: there is no such format, or it holds one mesh and there are several.
    """
    if format in (TABLE, LINES):
        return None
    texts = {name: output for name, output in DETECT_OUTPUTS.items() if output.write is not None}
    if format not in texts:
        raise ValueError(f"must be one of {', '.join([TABLE, LINES, *texts])}")
    if many and texts[format].write_all is None:
        raise ValueError(f"{format} holds one mesh, and there are several files")
    return texts[format]


class Listing:
    """Takes outcomes and prints the answers: at once where the format allows it, at the end otherwise."""

    def __init__(self, format: str, *, many: bool, options: Options) -> None:
        self._format = format
        self._output = output_for(format, many=many)
        self._many = many
        self._options = options
        self._kept: list[tuple[str, DetectResponse]] = []

    @property
    def include(self) -> tuple[Include, ...]:
        """What the format needs in an answer."""
        return self._output.include if self._output is not None else ()

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
        if self._output is not None:
            self._kept.append((str(outcome.path), response))
        elif self._format == TABLE:
            print_report(response)
        else:
            typer.echo(to_json(response, self._options.include))

    def end(self) -> None:
        """Print what waited for the last file."""
        output = self._output
        if output is None:
            return
        if output.write_all is not None and (self._many or output.is_collection):
            content = output.write_all(self._kept, self._options)
        elif output.write is not None and self._kept:
            content = output.write(self._kept[0][1], self._options)
        else:
            return
        typer.echo(content, nl=not content.endswith(b"\n"))
