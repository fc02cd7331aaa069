"""Property-based fuzzing of every reader: whatever the bytes, a usable mesh or an error that says why.

``TEST_FUZZ=100`` multiplies the number of examples and draws new ones each time, for a longer job.
"""

import os

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from model.errors import MeshError
from model.formats import FORMATS, read_mesh
from tests.model.mesh_files import KINDS, export, sample

LONGER = int(os.environ.get("TEST_FUZZ", "1"))
FUZZ = settings(
    max_examples=40 * LONGER,
    deadline=None,
    derandomize=LONGER == 1,
    database=None,
    suppress_health_check=list(HealthCheck),
)
LIMITS = {"max_vertices": 20_000, "max_faces": 20_000, "max_nodes": 1000, "max_unpacked_bytes": 1 << 20}
FILES = {kind: export(sample(), kind) for kind in KINDS}
# Words that mean something to one of the readers, and numbers at the edges of their types.
WORDS = [
    b"ply\n", b"format ascii 1.0\n", b"format binary_big_endian 1.0\n", b"element vertex 3\n", b"element face 2\n",
    b"property float x\n", b"property list uchar int vertex_indices\n", b"end_header\n", b"OFF\n", b"STOFF ",
    b"solid a\n", b"facet ", b"vertex ", b"v ", b"f ", b"\\\n", b"#", b"//", b"glTF", b"JSON", b"BIN\0",
    b'{"asset":{"version":"2.0"}}', b"PK\x03\x04", b"<model>", b"nan ", b"inf ", b"-1 ", b"0 ", b"4294967295 ",
    b"9223372036854775808 ", b"1e999 ", b"\xff\xff\xff\xff", b"\0\0\0\x80", b"\n", b" ",
]  # fmt: skip


def check(data: bytes, name: str) -> None:
    try:
        mesh = read_mesh(data, name, **LIMITS)
    except MeshError:
        return
    assert len(mesh.vertices) <= LIMITS["max_vertices"]
    assert 0 < len(mesh.faces) <= LIMITS["max_faces"]
    assert mesh.faces.min() >= 0
    assert mesh.faces.max() < len(mesh.vertices)
    assert np.isfinite(mesh.bounds).all()


@pytest.mark.parametrize("kind", KINDS)
def test_edits_of_a_good_file(kind: str) -> None:
    data = FILES[kind]
    places = st.integers(0, len(data)) | st.integers(0, 300)
    pieces = st.binary(max_size=12) | st.sampled_from(WORDS)
    edits = st.lists(st.tuples(places, st.integers(0, 20) | st.integers(0, len(data)), pieces), min_size=1, max_size=6)

    @FUZZ
    @given(edits)
    def fuzz(edits: list[tuple[int, int, bytes]]) -> None:
        changed = data
        for place, removed, piece in edits:
            changed = changed[:place] + piece + changed[place + removed :]
        check(changed, f"a.{kind.split('_')[0]}")

    fuzz()


@pytest.mark.parametrize("extension", FORMATS)
def test_anything_at_all(extension: str) -> None:
    @FUZZ
    @given(st.lists(st.sampled_from(WORDS) | st.binary(max_size=30), max_size=40).map(b"".join))
    def fuzz(data: bytes) -> None:
        check(data, f"a.{extension}")

    fuzz()


NUMBERS = st.floats(width=32) | st.integers(-5, 5) | st.sampled_from([1e30, -1e30, 1e-30, 2**31])


@FUZZ
@given(
    st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), max_size=12),
    st.lists(st.lists(st.integers(-14, 14), max_size=6), max_size=12),
)
def test_meshes_of_any_numbers(vertices: list[tuple[float, float, float]], faces: list[list[int]]) -> None:
    rows = [" ".join(map(str, row)) for row in vertices]
    corners = [" ".join(map(str, face)) for face in faces]
    check("".join(f"v {row}\n" for row in rows + ["f " + face for face in corners]).encode(), "a.obj")
    check(("".join(f"v {row}\n" for row in rows) + "".join(f"f {face}\n" for face in corners)).encode(), "a.obj")
    lengths = [f"{len(face)} {corner}" for face, corner in zip(faces, corners, strict=True)]
    body = "\n".join(rows + lengths)
    check(f"OFF\n{len(rows)} {len(faces)} 0\n{body}\n".encode(), "a.off")
    properties = "".join(f"property float {axis}\n" for axis in "xyz")
    head = f"ply\nformat ascii 1.0\nelement vertex {len(rows)}\n{properties}element face {len(faces)}\n"
    check(f"{head}property list uchar int vertex_indices\nend_header\n{body}\n".encode(), "a.ply")
