"""Reading: the same mesh out of every format, and numbers out of text."""

import numpy as np
import pytest

from model.formats import FORMATS, read_mesh
from model.formats._text import as_bytes, parse_numbers
from tests.model.mesh_files import BUILD, KINDS, XML_TETRAHEDRON, archive, export, sample


@pytest.mark.parametrize("kind", KINDS)
def test_every_format_gives_the_same_triangles(kind):
    mesh = sample()
    extension = kind.split("_")[0]
    read = read_mesh(export(mesh, kind), f"Some Name.{extension.upper()}")
    assert read.source_format == extension
    assert extension in FORMATS
    assert np.abs(read.vertices[read.faces] - mesh.vertices[mesh.faces]).max() < 2e-6  # float32 in most formats


def test_units_are_those_of_the_format():
    mesh = sample()
    assert read_mesh(export(mesh, "glb"), "a.glb").units == "meter"
    assert read_mesh(export(mesh, "obj"), "a.obj").units is None
    model = '<model unit="inch"><resources><object id="1"><mesh>{}</mesh></object></resources>{}</model>'
    assert read_mesh(archive(model.format(XML_TETRAHEDRON, BUILD)), "a.3mf").units == "inch"


NUMBERS = [
    "0", "-0", "1", "-1.5", "+2.25", ".5", "5.", "1e3", "1E+3", "-2.5e-3", "1.5e308", "1e-300",
    "0.1", "123456789012345", "0.000000123456789", "1234567.891", "3.141592653589793", "0.30000000000000004",
    "12345678901234567890123", "0.1234567890123456789", "1e22", "1e23", "2.5e-308", "1d2",
]  # fmt: skip


def test_numbers_are_exact_to_15_digits_and_within_two_units_beyond():
    values = parse_numbers(as_bytes(" ".join(NUMBERS).encode()))[0]
    assert len(values) == len(NUMBERS)
    for text, value in zip(NUMBERS, values, strict=True):
        exact = float(text.replace("d", "e"))
        digits = len(text.lower().split("e")[0].strip("+-").replace(".", "").lstrip("0"))
        if digits <= 15 and 1e-22 < abs(exact) < 1e22:
            assert value == exact, text
        assert abs(value - exact) <= 2 * np.spacing(abs(exact)), text


def test_random_numbers_survive_a_round_trip_through_text():
    rng = np.random.default_rng(31)
    exact = rng.normal(size=20_000) * 10.0 ** rng.integers(-12, 12, 20_000)
    values = parse_numbers(as_bytes("\n".join(map(repr, exact.tolist())).encode()))[0]
    assert np.abs((values - exact) / np.spacing(np.abs(exact))).max() <= 2
    # Opposite numbers stay opposite: no symmetry is lost in reading.
    assert np.array_equal(parse_numbers(as_bytes("\n".join(map(repr, (-exact).tolist())).encode()))[0], -values)
