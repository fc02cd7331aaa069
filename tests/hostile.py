"""Files that are broken or mean harm, as generators by class. ``scale`` 1 is a bounded load for a test run.

``python -m tests.hostile`` prints how many there are of each class.
"""

import io
import json
import random
import struct
import zipfile
from collections.abc import Callable, Iterator

import numpy as np
import trimesh

from tests.model.mesh_files import BUILD, KINDS, XML_TETRAHEDRON, archive, corners_gltf, export, sample, three_mf

Files = Iterator[tuple[str, bytes]]
NAN, INF, HUGE = "nan", "inf", "1e300"
FORMATS = ("stl", "obj", "ply", "off", "glb", "gltf", "3mf")
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def named(kind: str, stem: str = "a") -> str:
    return f"{stem}.{kind.split('_')[0]}"


def ply(vertices: str, faces: str, vertex_count: int = 3, face_count: int = 1, order: str = "ascii") -> bytes:
    head = (
        f"ply\nformat {order} 1.0\nelement vertex {vertex_count}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {face_count}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    return (head + vertices + faces).encode()


def stl(triangles: np.ndarray, announced: int | None = None) -> bytes:
    triangles = np.asarray(triangles, dtype="<f4").reshape(-1, 9)
    records = np.zeros((len(triangles), 50), dtype=np.uint8)
    records[:, 12:48] = triangles.view(np.uint8).reshape(-1, 36)
    return b"\0" * 80 + struct.pack("<I", len(triangles) if announced is None else announced) + records.tobytes()


def truncations(scale: float) -> Files:
    for kind in KINDS:
        data = export(sample(), kind)
        marks = {1, 4, 12, 20, 79, 80, 84, len(data) // 2, len(data) - 1, len(data) - 3}
        for word in (
            b"end_header",
            b"BIN\0",
            b"JSON",
            b"PK\x01\x02",
            b"PK\x05\x06",
            b"f ",
            b"facet",
            b'"buffers"',
            b"\n",
        ):
            at = data.find(word)
            marks |= {at, at + len(word)} if at > 0 else set()
        for cut in sorted(mark for mark in marks if 0 < mark < len(data)):
            yield named(kind, f"cut{cut}"), data[:cut]


def bit_flips(scale: float) -> Files:
    chance = random.Random(5)
    for kind in KINDS:
        data = export(sample(), kind)
        for number in range(int(12 * scale)):
            copy = bytearray(data)
            reach = len(data) if number % 2 else min(len(data), 400)
            for _ in range(chance.randint(1, 8)):
                copy[chance.randrange(reach)] ^= 1 << chance.randrange(8)
            yield named(kind, f"flip{number}"), bytes(copy)


def not_finite(scale: float) -> Files:
    for word in (NAN, INF, "-inf", HUGE, "1e999", "-1e61"):
        yield "a.obj", f"v {word} 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".encode()
        yield "a.off", f"OFF\n3 1 0\n{word} 0 0\n1 0 0\n0 1 0\n3 0 1 2\n".encode()
        yield "a.ply", ply(f"{word} 0 0\n1 0 0\n0 1 0\n", "3 0 1 2\n")
        facet = f"facet normal 0 0 0\nouter loop\nvertex {word} 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
        yield "a.stl", f"solid x\n{facet}endsolid x\n".encode()
        with np.errstate(over="ignore"):
            yield "b.stl", stl(np.array([float(word), 0, 0, 1, 0, 0, 0, 1, 0]))
        tetrahedron = XML_TETRAHEDRON.replace("x='0'", f"x='{word}'", 1).replace('x="0"', f'x="{word}"', 1)
        yield "a.3mf", three_mf(f"<object id='1'><mesh>{tetrahedron}</mesh></object>", "<item objectid='1'/>")


def huge_counts(scale: float) -> Files:
    for count in (2**31 - 1, 2**31, 2**32 - 1, 2**63, 10**30):
        yield "a.off", f"OFF\n{count} {count} 0\n0 0 0\n".encode()
        for order in ("ascii", "binary_little_endian", "binary_big_endian"):
            yield "a.ply", ply("0 0 0\n", "", count, 1, order)
            yield "b.ply", ply("0 0 0\n1 0 0\n0 1 0\n", "3 0 1 2\n", 3, count, order)
        if count < 2**32:
            yield "a.stl", stl(np.zeros((1, 9)), count)
            yield "a.glb", b"glTF" + struct.pack("<III4s", 2, count, count, b"JSON") + b"{}"
        for member in ("accessors", "bufferViews"):
            document = json.loads(corners_gltf({"indices": 1}, [0, 1, 2]))
            document[member][0]["count" if member == "accessors" else "byteLength"] = count
            yield "a.gltf", json.dumps(document).encode()
    yield "binary.ply", ply("", "", 0, 1, "binary_little_endian").replace(b"uchar int", b"uint int") + b"\xff" * 64


def bad_indices(scale: float) -> Files:
    for index in (-1, 3, 2**31 - 1, 2**31, -(2**31), 2**63, "1.5", "x"):
        yield "a.obj", f"{TRIANGLE}f 1 2 {index if index != 3 else 4}\n".encode()
        yield "a.off", f"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 {index}\n".encode()
        yield "a.ply", ply("0 0 0\n1 0 0\n0 1 0\n", f"3 0 1 {index}\n")
        body = XML_TETRAHEDRON.replace("v3='", f"v3='{index}", 1).replace('v3="', f'v3="{index}', 1)
        yield "a.3mf", three_mf(f"<object id='1'><mesh>{body}</mesh></object>", "<item objectid='1'/>")
    yield "a.gltf", corners_gltf({"indices": 1}, [0, 1, 250])
    for member, value in (("mesh", -1), ("mesh", 9), ("children", [0]), ("children", [-1]), ("children", [10**9])):
        document = json.loads(corners_gltf({"indices": 1}, [0, 1, 2]))
        document["nodes"][0][member] = value
        yield "a.gltf", json.dumps(document).encode()


def zip_bombs(scale: float) -> Files:
    size = int((64 << 20) * scale)
    spaces = archive("<model><metadata>" + " " * size + "</metadata></model>")
    yield "spaces.3mf", spaces
    yield "lying.3mf", spaces.replace(struct.pack("<I", size + 36), struct.pack("<I", 1000))
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as bomb:
        bomb.writestr("3D/3dmodel.model", "<model>" + "<x>" * (size // 3))
    yield "nested.3mf", out.getvalue()
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as bomb:
        bomb.writestr("3D/3dmodel.model", "<model x='" + "a" * size + "'/>")
    yield "attribute.3mf", out.getvalue()
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_LZMA) as other:
        other.writestr("3D/3dmodel.model", "<model/>")
    yield "lzma.3mf", out.getvalue()
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as many:
        for number in range(int(20_000 * scale)):
            many.writestr(str(number), b"")
    yield "entries.3mf", out.getvalue()


def scenes(scale: float) -> Files:
    count = int(300_000 * scale)
    chain = [{"mesh": 0, "children": [number + 1]} for number in range(count)] + [{"mesh": 0}]
    yield "deep.gltf", corners_gltf({"indices": 1}, [0, 1, 2], nodes=chain, scenes=[{"nodes": [0]}])
    flat = [{"mesh": 0}] * count
    yield "wide.gltf", corners_gltf({"indices": 1}, [0, 1, 2], nodes=flat, scenes=[{"nodes": list(range(count))}])
    yield "shared.gltf", corners_gltf({"indices": 1}, [0, 1, 2], nodes=[{"mesh": 0}], scenes=[{"nodes": [0] * count}])
    document = json.loads(corners_gltf({"indices": 1}, [0, 1, 2]))
    document["meshes"][0]["primitives"] *= count
    yield "primitives.gltf", json.dumps(document).encode()
    document = json.loads(corners_gltf({"indices": 1}, [0, 1, 2]))
    del document["accessors"][0]["bufferView"]
    document["accessors"][0]["count"] = 1 << 24
    yield "absent.gltf", json.dumps(document).encode()
    objects = f"<object id='0'><mesh>{XML_TETRAHEDRON}</mesh></object>"
    for number in range(1, 60):
        twice = f"<component objectid='{number - 1}'/>" * 2
        objects += f"<object id='{number}'><components>{twice}</components></object>"
    yield "doubling.3mf", three_mf(objects, "<item objectid='59'/>")
    chained = f"<object id='0'><mesh>{XML_TETRAHEDRON}</mesh></object>"
    for number in range(1, 3000):
        chained += f"<object id='{number}'><components><component objectid='{number - 1}'/></components></object>"
    yield "chain.3mf", three_mf(chained, "<item objectid='2999'/>")
    yield (
        "items.3mf",
        three_mf(f"<object id='1'><mesh>{XML_TETRAHEDRON}</mesh></object>", "<item objectid='1'/>" * count),
    )


def quadratic(scale: float) -> Files:
    count = int(400_000 * scale)
    yield "continued.obj", (TRIANGLE + "f 1 2 3" + "\\\n" * count + "\n").encode()
    yield "backslashes.obj", (TRIANGLE + "f " + "\\" * count + "\n").encode()
    yield "comment.obj", (TRIANGLE + "#\\\n" * count + "f 1 2 3\n").encode()
    yield "polygon.obj", (TRIANGLE + "f " + "1 2 3 " * count + "\n").encode()
    yield "words.obj", (TRIANGLE + "f 1" + "/" * count + " 2 3\n").encode()
    head = b"ply\nformat ascii 1.0\nelement vertex 3\n" + b"property float x\n" * int(50_000 * scale)
    yield "properties.ply", head + b"end_header\n" + b"0 " * count
    lists = b"ply\nformat binary_little_endian 1.0\nelement vertex 4000\n" + b"property list uchar int x\n" * 900
    yield "lists.ply", lists + b"property float x\nproperty float y\nproperty float z\nend_header\n" + bytes(8 << 20)
    yield "elements.ply", b"ply\nformat ascii 1.0\n" + b"element x 0\n" * int(80_000 * scale) + b"end_header\n"
    yield "digits.off", b"OFF\n3 1 0\n" + b"9" * count + b" 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    yield "brackets.gltf", b"[" * count
    yield "numbers.gltf", b"[" + b"1," * count + b"1]"
    yield "integer.gltf", b'{"asset": ' + b"9" * count + b"}"


def xml(scale: float) -> Files:
    laughs = "<!DOCTYPE m [<!ENTITY a0 'ha'>"
    for number in range(1, 20):
        laughs += f"<!ENTITY a{number} '" + f"&a{number - 1};" * 10 + "'>"
    yield "laughs.3mf", archive(laughs + "]><model><metadata>&a19;</metadata></model>")
    yield "outside.3mf", archive("<!DOCTYPE m [<!ENTITY x SYSTEM 'file:///etc/passwd'>]><model>&x;</model>")
    yield "dtd.3mf", archive("<!DOCTYPE m SYSTEM 'http://127.0.0.1:1/x.dtd'><model/>")
    yield "entity.3mf", archive("<model>&undefined;</model>")
    for encoding in ("utf-7", "idna", "cp037", "rot13", "zlib", "no-such"):
        yield "encoding.3mf", archive(f"<?xml version='1.0' encoding='{encoding}'?><model>{BUILD}</model>")
    for part in ("../../etc/passwd", "/etc/passwd", "\\\\host\\share", "3D/3dmodel.model"):
        item = f"<item objectid='1' p:path='{part}'/>"
        yield "path.3mf", three_mf(f"<object id='1'><mesh>{XML_TETRAHEDRON}</mesh></object>", item)


def outside(scale: float) -> Files:
    for uri in ("../../etc/passwd", "file:///etc/passwd", "http://127.0.0.1:1/x.bin", "data:,x", "data:;base64,%%%"):
        document = json.loads(corners_gltf({"indices": 1}, [0, 1, 2]))
        document["buffers"][0]["uri"] = uri
        yield "a.gltf", json.dumps(document).encode()
    yield "mtllib.obj", b"mtllib /etc/passwd\nusemtl x\n" + TRIANGLE.encode() + b"f 1 2 3\n"
    yield "call.obj", b"call /etc/passwd\n" + TRIANGLE.encode() + b"f 1 2 3\n"


def slivers(scale: float) -> Files:
    chance = np.random.default_rng(3)
    ends = chance.normal(size=(int(40_000 * scale), 2, 3))
    thin = np.concatenate([ends, ends[:, :1] + 1e-4 * chance.normal(size=(len(ends), 1, 3))], axis=1)
    yield "slivers.stl", stl(thin)
    yield "fan.stl", stl(np.concatenate([np.zeros_like(thin[:, :1]), thin[:, 1:]], axis=1))


def crossing(scale: float) -> Files:
    """Faces through the whole volume: files of some kilobytes on which no tree of boxes prunes."""
    chance = np.random.default_rng(8)
    for vertices, count in ((40, int(1000 * scale)), (120, int(10_000 * scale)), (2000, int(30_000 * scale))):
        points = chance.uniform(-1, 1, (vertices, 3))
        faces = np.array([chance.choice(vertices, 3, replace=False) for _ in range(count)])
        rows = "".join(f"{x:.4g} {y:.4g} {z:.4g}\n" for x, y, z in points.tolist())
        corners = "".join(f"3 {a} {b} {c}\n" for a, b, c in faces.tolist())
        yield f"crossing{count}.ply", ply(rows, corners, vertices, count)
    nearly = np.array([0.0, 0, 0, 1, 0.3, 0.2, 0.1, 1, 0.5]) + 1e-6 * chance.normal(size=(int(50_000 * scale), 9))
    yield "nearly_same.stl", stl(nearly)
    angles = np.linspace(0, 2 * np.pi, int(100_000 * scale), endpoint=False)
    edge = np.stack([np.cos(angles), 0.7 * np.sin(angles), 0 * angles], axis=1)
    fan = np.stack([np.tile(edge[0], (len(edge), 1)), edge, np.roll(edge, -1, axis=0)], axis=1)
    yield "fan_in_a_plane.stl", stl(fan)
    spokes = np.stack([np.tile([0.0, 0, -1], (len(edge), 1)), np.tile([0.0, 0, 1], (len(edge), 1)), edge], axis=1)
    yield "pencil.stl", stl(spokes[:: max(1, int(5 * scale))])


def many(scale: float) -> Files:
    """Much of the same: sheets on each other, loose triangles everywhere, and on a circle."""
    chance = np.random.default_rng(2)
    square = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])[[0, 1, 2, 0, 2, 3]]
    lifted = np.tile(square, (int(5000 * scale), 1, 1))
    lifted[:, :, 2] += 1e-5 * chance.normal(size=(len(lifted), 4))[:, [0, 1, 2, 0, 2, 3]]
    yield "sheets.stl", stl(lifted)
    count = int(100_000 * scale)
    loose = chance.uniform(-1, 1, (count, 1, 3)) + 1e-3 * chance.normal(size=(count, 3, 3))
    yield "pieces.stl", stl(loose)
    angles = 2 * np.pi * np.arange(count) / count
    turns = np.zeros((count, 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angles)
    turns[:, 1, 0], turns[:, 2, 2] = np.sin(angles), 1.0
    turns[:, 0, 1] = -turns[:, 1, 0]
    yield "orbit.stl", stl(([1.0, 0, 0] + 1e-5 * chance.normal(size=(3, 3))) @ turns.transpose(0, 2, 1))


def coincident(scale: float) -> Files:
    yield "same.stl", stl(np.tile([0.0, 0, 0, 1, 0, 0, 0, 1, 0], (int(400_000 * scale), 1)))
    yield "point.stl", stl(np.ones((int(100_000 * scale), 9)))


def degenerate(scale: float) -> Files:
    for size in (
        [0, 1, 1],
        [0, 0, 1],
        [0, 0, 0],
        [1e-300, 1, 1],
        [1e-30, 1e-30, 1e-30],
        [1e59, 1, 1e-59],
        [1e-9, 1, 1e9],
    ):
        box = trimesh.creation.box([1, 1, 1])
        rows = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in (box.vertices * size).tolist())
        yield "box.obj", (rows + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in box.faces)).encode()
    far = trimesh.creation.box([1, 1, 1])
    far.vertices += 1e15
    yield "far.ply", far.export(file_type="ply")
    yield "lonely.obj", (TRIANGLE + "v 1e50 0 0\nf 1 2 3\n").encode()


def polyglots(scale: float) -> Files:
    files = {kind: export(sample(), kind) for kind in KINDS}
    for kind in KINDS:
        for other in ("3mf", "stl", "ply", "glb"):
            yield named(kind, "glued"), files[kind] + files[other]
            yield named(kind, "led"), files[other][:84] + files[kind]
        yield named(kind, "shebang"), b"#!/bin/sh\n" + files[kind]
        yield named(kind, "bom"), b"\xef\xbb\xbf" + files[kind]
        for extension in FORMATS:
            yield f"wrong.{extension}", files[kind]
    for head in (
        b"%PDF-1.7\n",
        b"\x7fELF",
        b"\x89PNG\r\n\x1a\n",
        b"\x1f\x8b\x08",
        b"BZh9",
        b"7z\xbc\xaf",
        b"ustar",
        b"<html>",
    ):
        for extension in FORMATS:
            yield f"other.{extension}", head + bytes(200)


def tiny(scale: float) -> Files:
    for extension in FORMATS:
        yield f"empty.{extension}", b""
        for byte in (b"\0", b"\n", b"{", b"P", b"s", b"v", b"\xff"):
            yield f"one.{extension}", byte


def names(scale: float) -> Files:
    data = (TRIANGLE + "v 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n").encode()
    stems = ["../../etc/passwd", "C:\\Windows\\a", "Stühle №7", "\u202egnp", "a\u0000b", "😀", "%2e%2e%2fa", "x" * 5000]
    stems += ["-rf", "$(id)", "a;b|c", "con", "", ".", "a.obj\u2028x", "<script>", "a'b"]
    for stem in stems:
        yield f"{stem}.obj", data


_GENERATORS = (truncations, bit_flips, not_finite, huge_counts, bad_indices, zip_bombs, scenes, quadratic, xml, outside)
CLASSES: dict[str, Callable[[float], Files]] = {
    function.__name__.replace("_", " "): function
    for function in (*_GENERATORS, slivers, crossing, many, coincident, degenerate, polyglots, tiny, names)
}


if __name__ == "__main__":
    for title, generate in CLASSES.items():
        made = [len(data) for _, data in generate(1.0)]
        print(f"{title:14} {len(made):5} files, {sum(made) / 1e6:8.1f} MB")
