"""The multipart reader: what it accepts and refuses, and that the limit holds while the body streams in."""

import asyncio
import fcntl
import hashlib
import mmap
import os
from pathlib import Path
from typing import Any

import pytest
from fastapi import Request

from app.http.spool import Upload
from app.http.uploads import base_name, read_upload
from app.problems import ProblemError
from app.settings import Settings

BOUNDARY = "XbX"
LIMIT = 4096


def part(content: bytes, disposition: str = 'form-data; name="file"; filename="a.stl"') -> bytes:
    return f"--{BOUNDARY}\r\nContent-Disposition: {disposition}\r\n\r\n".encode() + content + b"\r\n"


def named(name: str) -> str:
    return f'form-data; name="file"; filename="{name}"'


END = f"--{BOUNDARY}--\r\n".encode()


class Body:
    """An ASGI ``receive`` that hands out chunks and counts how many were taken."""

    def __init__(self, chunks: list[bytes]) -> None:
        self.chunks = chunks
        self.taken = 0

    async def __call__(self) -> dict[str, Any]:
        chunk = self.chunks[self.taken]
        self.taken += 1
        return {"type": "http.request", "body": chunk, "more_body": self.taken < len(self.chunks)}


def read(
    body: Body,
    limit: int = LIMIT,
    spool_bytes: int = 1 << 20,
    spool_dir: str | None = None,
    cache_bytes: int = 1 << 20,
    **headers: str,
) -> Upload:
    headers = {"content_type": f"multipart/form-data; boundary={BOUNDARY}", **headers}
    raw = [(name.replace("_", "-").encode(), value.encode()) for name, value in headers.items()]
    scope = {"type": "http", "method": "POST", "path": "/detect", "headers": raw, "query_string": b""}
    settings = Settings(max_upload_bytes=limit, spool_bytes=spool_bytes, spool_dir=spool_dir, cache_bytes=cache_bytes)
    return asyncio.run(read_upload(Request(scope, body), settings))


def refusal(body: Body, limit: int = LIMIT, **options: Any) -> ProblemError:
    with pytest.raises(ProblemError) as caught:
        read(body, limit, **options)
    return caught.value


@pytest.mark.parametrize("size", [1, 2, 3, 5, 7, 16, 64, 10_000])
def test_every_way_to_cut_the_body_gives_the_same_bytes(size: int) -> None:
    content = b"\r\n--Xb\r\n--XbY\r--\n" + bytes(range(256)) + b"\r\n-"
    whole = part(content) + END
    chunks = [whole[i : i + size] for i in range(0, len(whole), size)]
    digest = hashlib.sha256(content).hexdigest()
    assert read(Body(chunks)) == Upload("a.stl", len(content), content, digest=digest)
    assert read(Body(chunks), cache_bytes=0) == Upload("a.stl", len(content), content)


@pytest.mark.parametrize("spool_bytes", [0, 1, 100, 10_000, 300_000])
def test_a_large_upload_goes_to_a_file_without_a_name(tmp_path: Path, spool_bytes: int) -> None:
    content = bytes(range(256)) * 2000
    whole = part(content) + END
    chunks = [whole[i : i + 60_000] for i in range(0, len(whole), 60_000)]
    with read(Body(chunks), limit=1 << 20, spool_bytes=spool_bytes, spool_dir=str(tmp_path)) as upload:
        assert (upload.filename, upload.size, upload.data) == ("a.stl", len(content), b"")
        assert isinstance(upload.source, int)
        assert os.pread(upload.source, 1 << 20, 0) == content
        assert list(tmp_path.iterdir()) == []
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(upload.source)


@pytest.mark.parametrize("place", ["disk", "memory"])
def test_nothing_can_change_an_upload_that_is_complete(tmp_path: Path, place: str) -> None:
    """Not by its descriptor, by a mapping, or by one opened anew (on disk: but as root, whom modes do not bind)."""
    content = bytes(range(256)) * 100
    opened = set(os.listdir("/proc/self/fd"))
    directory = str(tmp_path) if place == "disk" else "memory"
    with read(Body([part(content) + END]), limit=1 << 20, spool_bytes=10, spool_dir=directory) as upload:
        source = upload.source
        assert isinstance(source, int)
        assert set(os.listdir("/proc/self/fd")) - opened == {str(source)}  # no other descriptor of it is left
        for change in (
            lambda: os.pwrite(source, b"x", 0),
            lambda: os.ftruncate(source, 3),
            lambda: os.ftruncate(source, 1 << 20),
            lambda: mmap.mmap(source, 0, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE),
        ):
            with pytest.raises((OSError, ValueError)):
                change()
        if place == "memory":
            with open(f"/proc/self/fd/{source}", "r+b", buffering=0) as again, pytest.raises(PermissionError):
                again.write(b"x")
            with pytest.raises(PermissionError):  # nor can the seals be taken off
                fcntl.fcntl(source, fcntl.F_ADD_SEALS, 0)
        else:
            assert os.fstat(source).st_mode & 0o777 == 0
            assert os.fstat(source).st_nlink == 0
            assert fcntl.fcntl(source, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY
        assert os.pread(source, 1 << 20, 0) == content


def test_a_disk_that_cannot_be_written_to_is_no_defect(tmp_path: Path) -> None:
    folder = tmp_path / "spool"
    folder.mkdir()

    class Unmounting(Body):
        """The folder is there when the server starts, and gone when an upload comes."""

        async def __call__(self) -> dict[str, Any]:
            if self.taken == 0:
                folder.rmdir()
            return await super().__call__()

    chunks = [part(b"x" * 2000)[:-2], b"\r\n" + END]
    error = refusal(Unmounting(chunks), spool_bytes=10, spool_dir=str(folder))
    assert error.problem.slug == "overloaded"
    assert error.headers["Retry-After"]


def test_quoted_boundary_and_other_part_headers() -> None:
    body = part(b"x").replace(b"\r\n\r\n", b"\r\nContent-Type: model/obj\r\nX-Other: 1\r\n\r\n", 1) + END
    assert read(Body([body]), content_type=f'Multipart/Form-Data; boundary="{BOUNDARY}"').data == b"x"


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("chair.obj", "chair.obj"),
        ("C:\\models\\chair.obj", "chair.obj"),
        ("../../etc/chair.obj", "chair.obj"),
        ("a/b\\c.obj", "c.obj"),
        ("st\x00ru\x1bhl\n.obj", "struhl.obj"),
        ("Stühle №7.obj", "Stühle №7.obj"),
        ("x" * 400 + ".obj", "x" * 251 + ".obj"),
        ("dir/", ""),
        ("..", ""),
        (" ", ""),
    ],
)
def test_only_a_harmless_base_name_is_kept(given: str, kept: str) -> None:
    assert base_name(given) == kept


def test_utf8_name() -> None:
    body = part(b"x", 'form-data; name="file"; filename="Stühle.obj"') + END
    assert read(Body([body])).filename == "Stühle.obj"


@pytest.mark.parametrize(
    ("body", "says"),
    [
        (b"", "empty"),
        (END, 'no field "file"'),
        (part(b"x", 'form-data; name="mesh"; filename="a.stl"') + END, 'other than "file"'),
        (part(b"paper", 'form-data; name="mode"') + END, "query string"),
        (part(b"x") + part(b"y", named("b.obj")) + END, "several files that are meshes"),
        (part(b"x", named("a.bin")) + part(b"y", named("a.mtl")) + END, "none of which is a mesh"),
        (part(b"x") + part(b"y", named("A.STL")) + END, "several files of one name"),
        (b"".join(part(b"x", named(f"{i}.bin")) for i in range(65)) + END, "more than 64 files"),
        (b"".join(part(b"x", named(f"{i}{'y' * 240}.bin")) for i in range(40)) + END, "longer names"),
        (part(b"x") + part(b"paper", 'form-data; name="mode"') + END, "query string"),
        (part(b"x", 'form-data; name="file"') + END, "no file name"),
        (part(b"x", 'form-data; name="file"; filename=""') + END, "empty file name"),
        (part(b"x"), "closing boundary"),
        (part(b"x") + END[:5], "closing boundary"),
        (b"no boundary at all", "not well formed"),
        (f"--{BOUNDARY}\r\n\r\nx\r\n".encode() + END, "other than"),
    ],
)
def test_malformed_forms_are_told_apart(body: bytes, says: str) -> None:
    error = refusal(Body([body]), limit=100_000)
    assert error.problem.slug == "malformed-request"
    assert says in error.detail


@pytest.mark.parametrize(
    "content_type", ["application/json", "multipart/form-data", "multipart/mixed; boundary=XbX", "", ";;;="]
)
def test_other_content_types_are_refused_unread(content_type: str) -> None:
    body = Body([part(b"x") + END])
    assert refusal(body, content_type=content_type).problem.slug == "malformed-request"
    assert body.taken == 0


@pytest.mark.parametrize("spool_bytes", [0, 1 << 20])
@pytest.mark.parametrize("first", [True, False])
def test_files_that_a_mesh_refers_to_come_beside_it(tmp_path: Path, spool_bytes: int, first: bool) -> None:
    mesh, buffer = part(b"{}", named("models/a.GLTF")), part(b"\0\1\2", named("a.bin"))
    body = (mesh + buffer if first else buffer + mesh) + part(b"", named("wood.png")) + END
    with read(Body([body[:90], body[90:]]), spool_bytes=spool_bytes, spool_dir=str(tmp_path)) as upload:
        assert (upload.filename, upload.size) == ("a.GLTF", 5)
        both = (("a.GLTF", 2), ("a.bin", 3)) if first else (("a.bin", 3), ("a.GLTF", 2))
        assert upload.parts == (*both, ("wood.png", 0))
        content = upload.data if isinstance(upload.source, bytes) else os.pread(upload.source, 99, 0)
        assert content == (b"{}\0\1\2" if first else b"\0\1\2{}")


def test_declared_length_over_the_limit_is_refused_unread() -> None:
    body = Body([part(b"x") + END])
    assert refusal(body, content_length=str(LIMIT + 1)).problem.slug == "upload-too-large"
    assert body.taken == 0


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"content_length": "10"},
        {"content_length": "-1"},
        {"content_length": "²"},
        {"content_length": "9" * 5000},
    ],
)
def test_limit_counts_what_arrives_whatever_was_declared(headers: dict[str, str]) -> None:
    body = Body([part(b"")[:-2], *[b"x" * 1024] * 1000, b"\r\n", END])
    assert refusal(body, **headers).problem.slug == "upload-too-large"
    assert body.taken <= 1 + LIMIT // 1024  # refused on the first chunk beyond the limit, the rest never read


def test_a_body_of_exactly_the_limit_is_read() -> None:
    frame = len(part(b"") + END)
    content = b"x" * (LIMIT - frame)
    assert read(Body([part(content) + END])).data == content
    assert refusal(Body([part(content + b"x") + END])).problem.slug == "upload-too-large"
