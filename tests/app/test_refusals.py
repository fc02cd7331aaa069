"""The library refuses what the service refuses, and says what was probably meant."""

import re
from pathlib import Path
from typing import Any

import pytest

from app import align, complete, detect

CHAIR = Path(__file__).parents[1] / "data" / "chair.obj"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"max_error": -1.0}, "max_error: .*greater than 0"),
        ({"max_error": 2.0}, "max_error: .*less than or equal to 1"),
        ({"max_error": float("nan")}, "max_error: "),
        ({"tolerance": 0.0}, "tolerance: .*greater than 0"),
        ({"mode": "ful"}, "mode: .*probably full is meant"),
        ({"level": "Exact"}, "level: .*probably exact is meant"),
        ({"include": ["rejectd"]}, "include.0: .*probably rejected is meant"),
    ],
)
def test_detect_refuses_options(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        detect(CHAIR, **options)


def test_what_makes_meshes_refuses_thresholds_too() -> None:
    for make in (align, complete):
        with pytest.raises(ValueError, match=re.escape("max_error: Input should be greater than 0")):
            make(CHAIR, max_error=-1.0)
