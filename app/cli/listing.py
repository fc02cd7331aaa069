"""What ``prsnet detect`` says about many files: a table for people, or one of the formats for programs."""

import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from app.cli.batch import Outcome, named
from app.cli.inputs import unlike
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
    texts = _texts()
    if format not in texts:
        raise ValueError(f"must be one of {', '.join([TABLE, LINES, *texts])}")
    if many and texts[format].write_all is None:
        raise ValueError(f"{format} holds one mesh, and there are several files")
    return texts[format]


def format_of(path: Path) -> str:
    """The format that a file's name asks for; that for people where it asks for none."""
    name = path.suffix[1:].lower()
    return name if name == LINES or name in _texts() else TABLE


def _texts() -> dict[str, OutputFormat]:
    return {name: output for name, output in DETECT_OUTPUTS.items() if output.write is not None}


class Listing:
    """Takes outcomes and lists the answers: at once where the format allows it, at the end otherwise.

    They go to ``file`` instead of to standard output if there is one.

    Raises:
        ValueError: as `output_for`.
    """

    def __init__(self, format: str, paths: Sequence[Path], options: Options, file: Path | None = None) -> None:
        self._format = format
        self._output = output_for(format, many=len(paths) > 1)
        self._many = len(paths) > 1
        self._options = options
        self._file = file
        self._names = {path: str(path) for path in paths}
        if self._output is not None and self._output.entry_name is not None:
            self._names = unlike(paths, self._output.entry_name)
        self._kept: list[tuple[str, DetectResponse]] = []

    @property
    def include(self) -> tuple[Include, ...]:
        """What the format needs in an answer."""
        if self._format == TABLE:
            return ("rejected",)  # where nothing is found, the best of them is told
        return self._output.include if self._output is not None else ()

    @contextmanager
    def progress(self) -> Generator[Callable[[], None], None, None]:
        """A bar on standard error while there are several files and somebody looks; call what it gives after each."""
        if self._file is not None:  # what cannot be written is told before anything is computed
            self._file.parent.mkdir(parents=True, exist_ok=True)
            self._file.write_bytes(b"")
        console = Console(stderr=True)
        if not self._many or not console.is_terminal:
            yield lambda: None
            return
        columns = (TextColumn("detecting"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        # Where results are printed in between, the bar would be in their way unless they pass through it.
        with Progress(*columns, console=console, transient=True, redirect_stdout=sys.stdout.isatty()) as bar:
            task = bar.add_task("", total=len(self._names))
            yield lambda: bar.advance(task)

    def add(self, outcome: Outcome) -> None:
        """One outcome; those without an answer are not listed here."""
        response = outcome.response
        if response is None:
            return
        if self._many:
            response = named(response, outcome.path)
        if self._output is not None:
            self._kept.append((self._names[outcome.path], response))
        elif self._format == TABLE:
            print_report(response)
        else:
            self._write(to_json(response, self._options.include))

    def end(self) -> None:
        """List what waited for the last file."""
        output = self._output
        if output is None:
            return
        if output.write_all is not None and (self._many or output.entry_name is not None):
            content = output.write_all(self._kept, self._options)
        elif output.write is not None and self._kept:
            content = output.write(self._kept[0][1], self._options)
        else:
            return
        self._write(content)

    def _write(self, content: bytes) -> None:
        if not content.endswith(b"\n"):
            content += b"\n"
        if self._file is None:
            typer.echo(content, nl=False)
            return
        with self._file.open("ab") as file:
            file.write(content)
