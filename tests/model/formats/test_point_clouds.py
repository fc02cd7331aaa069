"""Point clouds in every format come out as the points that went in; broken ones are refused with a reason."""

import io
import os
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from model.errors import MeshError, MeshTooLargeError, UnreadableMeshError, UnsupportedFormatError
from model.formats import FORMATS, SOUGHT, read_mesh
from model.meshes.mesh import Mesh
from model.types import AnyArray, FloatArray

LONGER = int(os.environ.get("TEST_FUZZ", "1"))


def cloud() -> FloatArray:
    """800 points of a dome; numbers that 32 bits and 6 digits hold exactly."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-1.0, 1.0, (2, 800))
    return np.round(np.column_stack([x, y, 1.0 - 0.3 * (x * x + y * y)]) * 1024) / 1024


def rows(points: AnyArray, between: str = " ", head: str = "", tail: str = "") -> bytes:
    return (head + "".join(between.join(map(repr, row)) + tail + "\n" for row in points.tolist())).encode()


def pcd(points: AnyArray, data: str, *, fields: str = "x y z", types: str = "F F F", sizes: str = "4 4 4") -> bytes:
    names = fields.split()
    header = (
        f"# .PCD v.7 - Point Cloud Data file format\nVERSION .7\nFIELDS {fields}\nSIZE {sizes}\nTYPE {types}\n"
        f"COUNT {' '.join('1' for _ in names)}\nWIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
        f"POINTS {len(points)}\nDATA {data}\n"
    ).encode()
    codes = [f"<{kind.lower()}{size}" for kind, size in zip(types.split(), sizes.split(), strict=True)]
    table = np.zeros(len(points), dtype=list(zip(names, codes, strict=True)))
    for axis, column in zip("xyz", points.T, strict=True):
        table[axis] = column
    if data == "ascii":
        return header + "".join(" ".join(map(str, row)) + "\n" for row in table.tolist()).encode()
    if data == "binary":
        return header + table.tobytes()
    plain = b"".join(table[name].tobytes() for name in names)
    packed = lzf(plain)
    return header + struct.pack("<II", len(packed), len(plain)) + packed


def lzf(plain: bytes) -> bytes:
    """A packer that finds what repeats at a distance of its last occurrence, so that references are exercised."""
    out, run, at = bytearray(), bytearray(), 0
    last: dict[bytes, int] = {}

    def flush() -> None:
        for start in range(0, len(run), 32):
            piece = run[start : start + 32]
            out.extend(bytes([len(piece) - 1]) + piece)
        run.clear()

    while at < len(plain):
        key = plain[at : at + 3]
        back = at - last.get(key, -(1 << 20)) - 1
        last[key] = at
        length = 3
        if len(key) == 3 and back < 1 << 13:
            start = at - back - 1
            while length < 264 and at + length < len(plain) and plain[start + length] == plain[at + length]:
                length += 1
            flush()
            code = length - 2
            head = [(code << 5) | (back >> 8)] if code < 7 else [(7 << 5) | (back >> 8), code - 7]
            out.extend(bytes([*head, back & 255]))
            at += length
        else:
            run.append(plain[at])
            at += 1
    flush()
    return bytes(out)


def las(points: AnyArray, minor: int = 2, kind: int = 0, extra: int = 8) -> bytes:
    header = bytearray(375 if minor >= 4 else 227)
    header[:4] = b"LASF"
    header[24:26] = bytes([1, minor])
    struct.pack_into("<HI", header, 94, len(header), len(header))
    struct.pack_into("<BHI", header, 104, kind, 12 + extra, 0 if minor >= 4 else len(points))
    struct.pack_into("<6d", header, 131, *[2.0**-10] * 3, 5.0, 6.0, 7.0)
    if minor >= 4:
        struct.pack_into("<Q", header, 247, len(points))
    whole = np.round((points - [5.0, 6.0, 7.0]) * 1024).astype("<i4")
    return bytes(header) + b"".join(row.tobytes() + b"\x07" * extra for row in whole)


def saved(write: object, *args: object, **arrays: object) -> bytes:
    stream = io.BytesIO()
    write(stream, *args, **arrays)  # type: ignore[operator]
    return stream.getvalue()


def ply(points: AnyArray, order: str) -> bytes:
    head = f"ply\nformat {order} 1.0\nelement vertex {len(points)}\n" + "".join(
        f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz")
    )
    table = np.column_stack([points, np.tile([0.0, 0.0, 1.0], (len(points), 1))])
    body = rows(table) if order == "ascii" else table.astype("<f4").tobytes()
    return head.encode() + b"end_header\n" + body


POINTS = cloud()
WIDE = np.column_stack([POINTS, np.full((len(POINTS), 3), 200.0)])
PADDED = {"fields": "rgb x y intensity z", "types": "U F F U F", "sizes": "4 4 8 2 4"}
FILES: dict[str, tuple[str, bytes]] = {
    "blanks": ("xyz", rows(POINTS)),
    "colours behind": ("xyz", rows(WIDE)),
    "comments": ("xyz", rows(POINTS, "\t", "# made by\n// a scanner\n\n")),
    "count first": ("pts", rows(WIDE, head="800\n")),
    "carriage returns": ("xyz", rows(POINTS).replace(b"\n", b"\r")),
    "commas": ("csv", rows(POINTS, ",")),
    "headed": ("csv", rows(WIDE, ",", "x,y,z,r,g,b\n")),
    "headed otherwise": ("csv", rows(np.roll(WIDE, 3, axis=1), ",", '"r","g","b","X","Y","Z"\n')),
    "commented heading": ("csv", rows(WIDE, ",", "//X,Y,Z,Rf,Gf,Bf\n")),
    "decimal commas": ("csv", rows(POINTS, ";", "x;y;z\n").replace(b".", b",")),
    "pcd ascii": ("pcd", pcd(POINTS, "ascii")),
    "pcd binary": ("pcd", pcd(POINTS, "binary", **PADDED)),
    "pcd compressed": ("pcd", pcd(POINTS, "binary_compressed", **PADDED)),
    "npy": ("npy", saved(np.save, POINTS.astype(np.float32))),
    "npy by columns": ("npy", saved(np.save, np.asfortranarray(WIDE))),
    "npz": ("npz", saved(np.savez, colors=WIDE[:, 3:], points=POINTS)),
    "npz packed": ("npz", saved(np.savez_compressed, some=POINTS, other=np.zeros(3), words=np.array(["a"]))),
    "las": ("las", las(POINTS)),
    "las 1.4": ("las", las(POINTS, minor=4, kind=6, extra=18)),
    "ply ascii": ("ply", ply(POINTS, "ascii")),
    "ply binary": ("ply", ply(POINTS, "binary_little_endian")),
    "obj": ("obj", b"".join(b"v " + line + b"\n" for line in rows(POINTS).splitlines())),
    "off": ("off", f"OFF\n{len(POINTS)} 0 0\n".encode() + rows(POINTS)),
}


@pytest.mark.parametrize("name", FILES)
def test_points_come_out_as_they_went_in(name: str):
    extension, data = FILES[name]
    mesh = read_mesh(data, f"Scan.{extension.upper()}")
    assert (mesh.kind, mesh.source_format) == ("points", extension)
    distinct = np.unique(POINTS, axis=0)
    assert len(mesh.vertices) > 0.99 * len(distinct)  # those at one place, and perhaps one that stands alone, are not
    known = {tuple(row) for row in np.round(distinct, 6).tolist()}
    assert {tuple(row) for row in np.round(mesh.vertices, 6).tolist()} <= known
    assert any("800 points" in warning for warning in mesh.warnings)


def test_triangles_beside_points_in_an_archive_are_a_mesh():
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    data = saved(np.savez, vertices=np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), faces=tetrahedron)
    mesh = read_mesh(data, "a.npz")
    assert (mesh.kind, mesh.faces.tolist(), mesh.watertight) == ("mesh", tetrahedron.tolist(), True)


def test_places_without_a_point_are_left_out_and_counted():
    holes = np.concatenate([POINTS, np.full((200, 3), np.nan)])
    mesh = read_mesh(pcd(holes, "binary"), "a.pcd")
    assert any("200 points without finite coordinates" in warning for warning in mesh.warnings)
    assert np.isfinite(mesh.vertices).all()


def test_tables_and_arrays_in_a_folder_are_not_taken_for_shapes():
    assert {"csv", "npy", "npz"} == set(FORMATS) - SOUGHT


class Touch:
    def __reduce__(self) -> tuple[object, tuple[str, ...]]:
        return os.mkdir, (os.environ["TOUCHED"],)


def test_objects_are_never_unpickled(monkeypatch: pytest.MonkeyPatch, tmp_path):
    monkeypatch.setenv("TOUCHED", str(tmp_path / "touched"))
    array = np.empty((2, 3), dtype=object)
    array[:] = Touch()
    for name, data in (("a.npy", saved(np.save, array)), ("a.npz", saved(np.savez, points=array))):
        with pytest.raises(UnreadableMeshError):
            read_mesh(data, name)
    assert not (tmp_path / "touched").exists()


HUGE = (
    b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (9999999999999, 3), }".ljust(127) + b"\n"
)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.npy", HUGE),
        ("a.npy", saved(np.save, np.zeros((100, 2)))),
        ("a.npy", saved(np.save, np.array(["x"] * 100))),
        ("a.npz", saved(np.savez, weights=np.zeros(7))),
        ("a.las", las(POINTS)[:3000]),
        ("a.las", las(POINTS)[:200]),
        ("a.las", las(POINTS, kind=128)),
        ("a.pcd", pcd(POINTS, "binary").replace(b"POINTS 800", b"POINTS 900")),
        ("a.pcd", pcd(POINTS, "binary").replace(b"POINTS 800", b"POINTS 99999999999")),
        ("a.pcd", pcd(POINTS, "binary").replace(b"FIELDS x y z", b"FIELDS x y w")),
        ("a.pcd", pcd(POINTS, "binary").replace(b"SIZE 4 4 4", b"SIZE 4 4 3")),
        ("a.pcd", pcd(POINTS, "binary").replace(b"DATA binary", b"DATA magic!")),
        ("a.pcd", pcd(POINTS, "binary_compressed")[:-9]),
        ("a.xyz", b"these are words, not numbers\n" * 100),
        ("a.xyz", rows(POINTS[:, :2])),
        ("a.xyz", b"\0\1\2\3" * 400),
    ],
)
def test_broken_clouds_are_refused(name: str, data: bytes):
    with pytest.raises(UnreadableMeshError):
        read_mesh(data, name)


def test_damaged_packed_data_are_refused():
    data = bytearray(pcd(POINTS, "binary_compressed", **PADDED))
    start = data.index(b"compressed\n") + len(b"compressed\n")
    unpacked = int.from_bytes(data[start + 4 : start + 8], "little")
    data[start + 4 : start + 8] = struct.pack("<I", unpacked + 1)
    with pytest.raises(UnreadableMeshError, match="damaged"):
        read_mesh(bytes(data), "a.pcd")
    data[start + 4 : start + 8] = struct.pack("<I", 2**31)
    with pytest.raises((UnreadableMeshError, MeshTooLargeError)):
        read_mesh(bytes(data), "a.pcd")


@pytest.mark.parametrize("name", ["blanks", "commas", "pcd binary", "npy", "npz", "las", "ply binary"])
def test_limits_hold(name: str):
    extension, data = FILES[name]
    with pytest.raises(MeshTooLargeError):
        read_mesh(data, f"a.{extension}", max_vertices=300)
    with pytest.raises(MeshTooLargeError):
        read_mesh(data, f"a.{extension}", max_faces=100)


def test_an_archive_that_unpacks_to_too_much_is_refused():
    data = saved(np.savez_compressed, points=np.zeros((100_000, 3)))
    with pytest.raises(MeshTooLargeError):
        read_mesh(data, "a.npz", max_unpacked_bytes=1 << 20)


@pytest.mark.parametrize(
    ("is_named", "name"), [("xyz", "ply binary"), ("csv", "pcd binary"), ("npy", "npz"), ("ply", "las")]
)
def test_misnamed_clouds_are_called_what_they_are(is_named: str, name: str):
    extension, data = FILES[name]
    with pytest.raises(UnsupportedFormatError, match=f"rename it to .{extension}"):
        read_mesh(data, f"a.{is_named}")


@pytest.mark.parametrize("name", ["headed", "pcd ascii", "pcd binary", "pcd compressed", "npy", "npz packed", "las"])
def test_edits_of_a_good_cloud(name: str):
    extension, data = FILES[name]
    places = st.integers(0, len(data)) | st.integers(0, 300)
    pieces = st.binary(max_size=12) | st.sampled_from(
        [b"nan ", b"1e999 ", b"-1 ", b"\xff" * 8, b"\n", b"'|O'", b"x,y,z"]
    )
    edits = st.lists(st.tuples(places, st.integers(0, 20) | st.integers(0, len(data)), pieces), min_size=1, max_size=5)

    @settings(
        max_examples=25 * LONGER,
        deadline=None,
        derandomize=LONGER == 1,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(edits)
    def fuzz(edits: list[tuple[int, int, bytes]]) -> None:
        changed = data
        for place, removed, piece in edits:
            changed = changed[:place] + piece + changed[place + removed :]
        try:
            mesh = read_mesh(
                changed, f"a.{extension}", max_vertices=20_000, max_faces=60_000, max_unpacked_bytes=1 << 20
            )
        except MeshError:
            return
        assert isinstance(mesh, Mesh)
        assert np.isfinite(mesh.bounds).all()

    fuzz()
