"""Warming up: compiles or loads all kernels and modules, so that the first request is as fast as the next."""

import contextlib
import encodings
import importlib
import itertools
import pkgutil
import struct
from collections.abc import Iterable
from typing import Any, get_args

from app.detection import SymmetryDetector
from app.outputs.registry import DETECT_OUTPUTS, MESH_WRITERS
from app.schemas import Include, Mode
from app.workers.jobs import perform
from app.workers.wire import Job
from model.formats.reading import read_mesh, warm_up_kernels

_CORNERS = [(x, 2 * y, 3 * z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
# Quadrilaterals and triangles, because readers treat faces of one size and of several sizes differently.
_QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6)]
_TRIANGLES = [(0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
_SPLIT = [*_TRIANGLES, *[(a, b, c) for a, b, c, _ in _QUADS], *[(a, c, d) for a, _, c, d in _QUADS]]
_MIXED = [*_QUADS, *_TRIANGLES]
_CLOUD = [
    (x / 2, y / 2, z / 2)
    for x, y, z in itertools.product(range(3), range(5), range(7))
    if x in (0, 2) or y in (0, 4) or z in (0, 6)
]
_PLY_HEADER = (
    "ply\nformat {} 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
    "element face {}\nproperty list uchar int vertex_indices\nend_header\n"
)


def warm_up(detector: SymmetryDetector) -> None:
    """Warm up the detector, the readers on small files of every format that has kernels, and the way to an answer.

    A worker may open no file: whatever is imported, compiled or read from a cache at first use is used here.
    """
    detector.warm_up()
    for name, data in (*sample_files(), *sample_clouds()):
        _ = read_mesh(data, name).watertight
    warm_up_kernels()
    for job, data in sample_jobs():
        perform(detector, job, data)
    for module in pkgutil.iter_modules(encodings.__path__):
        with contextlib.suppress(ImportError):  # some are for other systems
            importlib.import_module(f"encodings.{module.name}")


def sample_jobs() -> list[tuple[Job, bytes]]:
    """Jobs that take every way a job can take, on small meshes: some whole, one lacking what its mirror image has."""
    include = list(get_args(Include))
    name, whole = sample_files()[0]
    half = f"OFF\n8 {len(_MIXED) - 2} 0\n{_lines(_CORNERS)}\n{_lines((len(f), *f) for f in _MIXED[:-2])}\n".encode()
    common: dict[str, Any] = {
        "max_error": 1.0, "include": include, "max_vertices": 100, "max_faces": 100, "max_nodes": 100,
        "max_unpacked_bytes": 1 << 20, "cpu_s": 60.0, "transport": "inline", "max_answer_bytes": 1 << 20,
    }  # fmt: skip
    annotated = [name for name, output in DETECT_OUTPUTS.items() if output.mesh is not None]
    jobs = [
        (Job(name, mode, size=len(whole), geometry=geometry, **common), whole)
        for mode, geometry in itertools.product(get_args(Mode), (None, *annotated))
    ]
    for geometry, symmetrize in itertools.product(MESH_WRITERS, (False, True)):
        ways: dict[str, Any] = {"task": "complete", "geometry": geometry, "symmetrize": symmetrize}
        jobs.append((Job("half.off", "full", size=len(half), plane=[0.0, 0.0, 1.0, -1.5], **ways, **common), half))
    header = _PLY_HEADER.replace(
        "float z\n", "float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
    )
    corners = "\n".join(f"{line} 200 0 0" for line in _lines(_CORNERS).split("\n"))
    faces = _lines((len(face), *face) for face in _MIXED)
    colored = f"{header.format('ascii', len(_MIXED))}{corners}\n{faces}\n".encode()
    for edit in ({"task": "halve", "capped": True}, {"task": "sector", "order": 2, "capped": True}, {"task": "align"}):
        jobs.append((Job("colored.ply", "full", size=len(colored), geometry="ply", **edit, **common), colored))
    parts = _painted()
    painted = b"".join(content for _, content in parts)
    ways = {"task": "halve", "geometry": "glb", "plane": [1.0, 0.0, 0.0, -0.5]}
    ways["parts"] = [[name, len(content)] for name, content in parts]
    jobs.append((Job("box.obj", "full", size=len(painted), **ways, **common), painted))
    return jobs


def _painted() -> list[tuple[str, bytes]]:
    """The box with a picture: the mesh, its materials and what passes for a picture."""
    faces = "".join("f " + " ".join(f"{index + 1}/1" for index in face) + "\n" for face in _MIXED)
    text = "mtllib box.mtl\nv " + _lines(_CORNERS, "\nv ") + "\nvt 0.5 0.5\nusemtl a\n" + faces
    return [
        ("box.obj", text.encode()),
        ("box.mtl", b"newmtl a\nKd 1 0 0\nmap_Kd box.png\n"),
        ("box.png", b"\x89PNG\r\n\x1a\n"),
    ]


def sample_files() -> list[tuple[str, bytes]]:
    """A box of 1 x 2 x 3 units as name and content, in all variants that are read by different kernels."""
    corners = _lines(_CORNERS)
    with_counts = _lines((len(face), *face) for face in _MIXED)
    only_triangles = _lines((3, *face) for face in _SPLIT)
    return [
        ("box.obj", ("v " + _lines(_CORNERS, "\nv ") + "\n" + _obj_faces()).encode()),
        ("mixed.off", f"OFF\n8 {len(_MIXED)} 0\n{corners}\n{with_counts}\n".encode()),
        ("triangles.off", f"OFF\n8 {len(_SPLIT)} 0\n{corners}\n{only_triangles}\n".encode()),
        ("mixed.ply", f"{_PLY_HEADER.format('ascii', len(_MIXED))}{corners}\n{with_counts}\n".encode()),
        (
            "triangles.ply",
            f"{_PLY_HEADER.format('ascii', len(_SPLIT))}{corners}\n{only_triangles}\n".encode(),
        ),
        ("broken_lines.ply", f"{_PLY_HEADER.format('ascii', len(_MIXED))}{corners} {_words(_MIXED)}\n".encode()),
        ("mixed_binary.ply", _binary_ply(_MIXED)),
        ("triangles_binary.ply", _binary_ply(_SPLIT)),
        ("ascii.stl", _ascii_stl()),
        ("binary.stl", _binary_stl()),
    ]


def sample_clouds() -> list[tuple[str, bytes]]:
    """Points of the same box, in the variants that are read by different kernels."""
    return [("cloud.xyz", _lines(_CLOUD).encode()), ("cloud.pcd", _packed_pcd())]


def _packed_pcd() -> bytes:
    count = len(_CLOUD)
    plain = b"".join(struct.pack(f"<{count}f", *column) for column in zip(*_CLOUD, strict=True))
    # LZF that packs nothing: runs of up to 32 bytes as they are.
    runs = (plain[at : at + 32] for at in range(0, len(plain), 32))
    packed = b"".join(bytes([len(run) - 1]) + run for run in runs)
    header = f"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {count}\nHEIGHT 1\nPOINTS {count}\n"
    return f"{header}DATA binary_compressed\n".encode() + struct.pack("<II", len(packed), len(plain)) + packed


def _lines(rows: Iterable[tuple[float, ...]], between: str = "\n") -> str:
    return between.join(" ".join(map(str, row)) for row in rows)


def _words(faces: list[tuple[int, ...]]) -> str:
    return " ".join(f"{len(face)} {' '.join(map(str, face))}" for face in faces)


def _obj_faces() -> str:
    return "".join("f " + " ".join(str(index + 1) for index in face) + "\n" for face in _MIXED)


def _binary_ply(faces: list[tuple[int, ...]]) -> bytes:
    header = _PLY_HEADER.format("binary_little_endian", len(faces)).encode()
    vertices = b"".join(struct.pack("<3f", *corner) for corner in _CORNERS)
    return header + vertices + b"".join(struct.pack(f"<B{len(face)}i", len(face), *face) for face in faces)


def _ascii_stl() -> bytes:
    facets = (
        "facet normal 0 0 0\nouter loop\nvertex "
        + _lines((_CORNERS[index] for index in face), "\nvertex ")
        + "\nendloop\nendfacet\n"
        for face in _SPLIT
    )
    return f"solid box\n{''.join(facets)}endsolid box\n".encode()


def _binary_stl() -> bytes:
    facets = (struct.pack("<12fH", 0, 0, 0, *(x for index in face for x in _CORNERS[index]), 0) for face in _SPLIT)
    return b"\0" * 80 + struct.pack("<I", len(_SPLIT)) + b"".join(facets)
