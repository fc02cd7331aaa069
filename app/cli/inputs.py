"""Which files a command is about, what each is called, and what may be written for them."""

import glob
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from pathlib import Path

import typer

from model.formats import SOUGHT

STANDARD_INPUT = "-"
_OWN_ENDING = "-symmetries.glb"
_OWN_MARK = b'"generator":"prsnet"'


def expand(names: Iterable[str]) -> tuple[list[Path], list[tuple[Path, str]]]:
    """The files that names, folders with all they contain, and patterns stand for, each once; and what names none.

    Of a folder only files of a known format are taken, and of a folder or a pattern none that ``prsnet detect --glb``
    wrote; a file that is named is taken whatever it is called. The second list says why a name stands for nothing.
    """
    found: dict[Path, None] = {}
    missing: list[tuple[Path, str]] = []
    for name in names:
        path = Path(name)
        if path.is_dir():
            inside = (item for item in path.rglob("*") if item.suffix[1:].lower() in SOUGHT and item.is_file())
            matches, reason = sorted(inside), "The folder holds no mesh files."
        elif path.exists() or not glob.has_magic(name):
            found[path] = None
            continue
        else:
            matches = sorted(Path(item) for item in glob.glob(name, recursive=True) if Path(item).is_file())
            reason = "No file has such a name."
        matches = [item for item in matches if not _is_own(item)]
        if not matches:
            missing.append((path, reason))
        found.update(dict.fromkeys(matches))
    return list(found), missing


def _is_own(path: Path) -> bool:
    """Whether a file was written by ``prsnet detect --glb``."""
    if not path.name.endswith(_OWN_ENDING):
        return False
    try:
        with path.open("rb") as file:
            return _OWN_MARK in file.read(200)
    except OSError:
        return False


def unlike(paths: Iterable[Path], key: Callable[[Path], str]) -> dict[Path, str]:
    """A name for every file: ``key`` of it, with its folders, and its extension too, where others have the same."""
    paths = list(paths)
    names = {path: key(path) for path in paths}
    shared = os.path.commonpath([path.parent.absolute() for path in paths]) if paths else ""
    for name_of in (_with_folders, _with_extension):
        count = Counter(name.casefold() for name in names.values())
        for path, name in list(names.items()):
            if count[name.casefold()] > 1:
                names[path] = name_of(path, Path(shared), key)
    return names


def _with_folders(path: Path, shared: Path, key: Callable[[Path], str]) -> str:
    return (path.absolute().parent.relative_to(shared) / key(path)).as_posix()


def _with_extension(path: Path, shared: Path, key: Callable[[Path], str]) -> str:
    return (path.absolute().parent.relative_to(shared) / (key(path) + path.suffix)).as_posix()


def require_free(paths: Iterable[Path], overwrite: bool) -> None:
    """Refuse to write over files that are there, unless that is asked for."""
    there = [path for path in paths if path.exists()]
    if there and not overwrite:
        more = f" and {len(there) - 1} more" if len(there) > 1 else ""
        raise typer.BadParameter(f"{there[0]}{more}: there already; --overwrite replaces it", param_hint="--output")


@contextmanager
def standard_input(names: list[str]) -> Generator[list[str], None, None]:
    """The same names, with a file that holds the standard input for ``-``; it is gone afterwards.

    Raises:
        typer.BadParameter: the input is of no format that its content tells.
    """
    if STANDARD_INPUT not in names:
        yield names
        return
    from model.formats.reading import content_format  # here: with the readers come their kernels

    data = sys.stdin.buffer.read()
    kind = content_format(data)
    if kind is None:
        raise typer.BadParameter(
            "the standard input is of no known format, or of one that only a file's name tells",
            param_hint=STANDARD_INPUT,
        )
    with tempfile.TemporaryDirectory(prefix="prsnet-") as folder:
        path = Path(folder) / f"stdin.{kind}"
        path.write_bytes(data)
        yield [str(path) if name == STANDARD_INPUT else name for name in names]
