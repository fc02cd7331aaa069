"""The table of formats: every line names a test that there is."""

import re

import pytest

from model.formats import FORMATS

from ..e2e.server import ROOT

PAGE = (ROOT / "docs" / "formats.md").read_text()
NAMED = re.findall(r"\| `([\w/]+\.py)::(\w+)` \|$", PAGE, re.MULTILINE)


def test_every_line_names_a_test() -> None:
    held = PAGE.partition("## Public files")[0]
    lines = [line for line in held.splitlines() if line.startswith("| ") and not line.startswith("| ---")]
    headings = [line for line in lines if line.endswith("| test |")]
    assert len(NAMED) == len(lines) - len(headings) > 30


@pytest.mark.parametrize(("file", "name"), NAMED)
def test_the_test_exists(file: str, name: str) -> None:
    path = ROOT / (file if "/" in file else f"tests/model/formats/{file}")
    assert re.search(rf"^def {name}\(", path.read_text(), re.MULTILINE)


def test_every_format_is_told_of() -> None:
    for name in FORMATS:
        assert re.search(rf"\b{name}\b", PAGE, re.IGNORECASE)
