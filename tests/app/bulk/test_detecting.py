"""One actor's work, without Ray: real worker processes, files that do harm, shards, a bucket."""

import hashlib
import io
import tarfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("ray", reason="the extra bulk is not installed")
from pyarrow import parquet

from app.bulk.detecting import BulkDetector, Task
from app.bulk.locations import Store
from app.bulk.plan import Piece, pieces
from app.settings import Settings
from app.workers.errors import DefectError, OutOfMemoryError, WorkerLostError
from model.errors import EmptyMeshError
from tests.app.fakes import DATA

from .buckets import Bucket, bucket

SETTINGS: dict[str, Any] = {"workers": 1, "max_upload_bytes": 4 << 20}


@pytest.fixture(scope="module")
def s3() -> Iterator[Bucket]:
    with bucket() as started:
        yield started


@pytest.fixture(scope="module")
def actor(s3: Bucket, tmp_path_factory: pytest.TempPathFactory) -> Iterator[BulkDetector]:
    """Reads from the bucket, writes to a folder."""
    target = tmp_path_factory.mktemp("rows")
    settings = Settings(**SETTINGS).model_dump(exclude={"api_keys"})
    started = BulkDetector(Task(s3.uri("in"), str(target), "full", 4e-4, "auto", None, settings))
    yield started
    started.close()


def rows_of(actor: BulkDetector, s3: Bucket, files: Mapping[str, bytes]) -> dict[str, dict[str, Any]]:
    """Put files into the bucket, have them worked on, and read their rows."""
    folder = f"in/{time.monotonic_ns()}"
    s3.put({f"{folder}/{name}": data for name, data in files.items()})
    inputs = Store(s3.uri(folder)).list_inputs()
    for piece in pieces(inputs, 1, most=len(files)) if any(item.is_shard for item in inputs) else [one_piece(inputs)]:
        actor.work(piece)
    target = actor._target.root
    rows = [row for file in Path(target).glob("*.parquet") for row in parquet.read_table(file).to_pylist()]
    for file in Path(target).glob("*.parquet"):
        file.unlink()
    prefix = f"s3://{s3.name}/{folder}/"
    found = {row["path"].removeprefix(prefix): row for row in rows}
    assert len(found) == len(rows)
    return found


def one_piece(inputs: list[Any]) -> Piece:
    return Piece([item.path for item in inputs], [item.size for item in inputs], False)


def test_good_and_bad_files_of_a_bucket_get_a_row_each(actor: BulkDetector, s3: Bucket) -> None:
    files = {
        "chair.obj": (DATA / "chair.obj").read_bytes(),
        "empty.ply": b"",
        "cut.stl": (DATA / "barrel.stl").read_bytes()[:-7],
        "huge.ply": b"\0" * ((4 << 20) + 1),
        "table.GLB": (DATA / "table.glb").read_bytes(),
    }
    rows = rows_of(actor, s3, files)
    assert {name: row["problem"] for name, row in rows.items()} == {
        "chair.obj": None,
        "empty.ply": "unreadable-mesh",
        "cut.stl": "unreadable-mesh",
        "huge.ply": "upload-too-large",
        "table.GLB": None,
    }
    for name, row in rows.items():
        assert (row["detail"] is None) == (row["point_group"] is not None) == (row["problem"] is None)
        assert row["bytes"] == len(files[name])
        if name == "huge.ply":
            assert row["sha256"] is row["worker_ms"] is None  # not read at all
        else:
            assert row["sha256"] == hashlib.sha256(files[name]).hexdigest()
            assert row["worker_ms"] > 0
    row = rows["chair.obj"]
    assert (row["point_group"], row["mesh"]["filename"], row["mesh"]["faces"]) == ("Cs", "chair.obj", 260)
    assert abs(row["planes"][0]["normal"][0]) == pytest.approx(1.0, abs=1e-6)


def test_a_file_that_takes_too_long_ends_its_worker_and_not_the_rest(
    actor: BulkDetector, s3: Bucket, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = {"chair.obj": (DATA / "chair.obj").read_bytes()}
    with monkeypatch.context() as patch:
        patch.setattr(actor, "_settings", actor._settings.model_copy(update={"deadline_s": 1e-3}))
        rows = rows_of(actor, s3, files)
    assert rows["chair.obj"]["problem"] == "deadline-passed"
    assert rows_of(actor, s3, files)["chair.obj"]["problem"] is None


@pytest.mark.parametrize(
    ("error", "problem"),
    [
        (WorkerLostError(), "worker-lost"),
        (OutOfMemoryError(), "mesh-too-large"),
        (DefectError("Traceback: secret"), "internal-error"),
        (EmptyMeshError("The file holds no faces."), "empty-mesh"),
    ],
)
def test_whatever_a_worker_comes_to_is_a_row(
    actor: BulkDetector, s3: Bucket, monkeypatch: pytest.MonkeyPatch, error: Exception, problem: str
) -> None:
    async def run(*_: object) -> None:
        raise error

    monkeypatch.setattr(actor._pool, "run", run)
    row = rows_of(actor, s3, {"a.obj": b"v 0 0 0"})["a.obj"]
    assert row["problem"] == problem
    assert row["detail"].endswith(".")
    assert "secret" not in row["detail"]


def tar(files: Mapping[str, bytes], mode: str = "w") -> bytes:
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode=mode) as archive:
        for name, data in files.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(data)
            archive.addfile(entry, io.BytesIO(data))
    return packed.getvalue()


def test_shards_have_a_row_a_mesh_and_a_damaged_one_says_so(actor: BulkDetector, s3: Bucket) -> None:
    chair, plant = ((DATA / name).read_bytes() for name in ("chair.obj", "plant.off"))
    whole = tar({"a/0.obj": chair, "a/0.json": b"{}", "a/1.off": plant, "a/2.obj": b"nothing"})
    packed = tar({"0.obj": chair, "1.obj": chair}, "w:gz")
    shards = {"whole.tar": whole, "cut.tar": whole[: len(whole) // 2], "packed.tar.gz": packed, "none.tar": tar({})}
    rows = rows_of(actor, s3, shards)
    assert {name: row["problem"] for name, row in rows.items()} == {
        "whole.tar/a/0.obj": None,
        "whole.tar/a/1.off": None,
        "whole.tar/a/2.obj": "empty-mesh",
        "cut.tar/a/0.obj": None,
        "cut.tar": "unreadable-shard",
        "packed.tar.gz/0.obj": None,
        "packed.tar.gz/1.obj": None,
        "none.tar": "unreadable-shard",
    }
    assert {row["shard"].rpartition("/")[2] for row in rows.values()} == set(shards)
    assert rows["whole.tar/a/1.off"]["mesh"]["filename"] == "1.off"


def test_a_file_that_has_gone_since_it_was_listed_gets_a_row(actor: BulkDetector, s3: Bucket) -> None:
    actor.work(Piece([f"s3://{s3.name}/in/gone.obj"], [10], False))
    (file,) = Path(actor._target.root).glob("*.parquet")
    (row,) = parquet.read_table(file).to_pylist()
    file.unlink()
    assert row["problem"] == "not-read"
    assert row["sha256"] is None
