"""What a row holds, where inputs are found, and how they are cut into pieces."""

import dataclasses
import json
import time
from pathlib import Path

import pytest

pytest.importorskip("ray", reason="the extra bulk is not installed")
import pyarrow as pa
from pyarrow import parquet
from pydantic import BaseModel

from app.bulk import columns
from app.bulk.job import run
from app.bulk.locations import Input, LocationError, Store
from app.bulk.plan import missing, pieces
from app.bulk.results import AnotherRunError, Done, Part, Results
from app.bulk.summary import summarise
from app.detection import to_response
from app.schemas import DetectResponse, to_json
from model.formats import read_mesh
from tests.app.fakes import DATA, FakeDetector

from .buckets import bucket


@pytest.fixture
def answer() -> DetectResponse:
    detector = FakeDetector()
    mesh = read_mesh((DATA / "chair.obj").read_bytes(), "chair.obj")
    now = time.perf_counter()
    return to_response(detector.detect(mesh), detector, "chair.obj", (), now, now)


def test_a_row_holds_the_whole_answer(answer: DetectResponse) -> None:
    rows = [{"path": "a.obj", "bytes": 3, **columns.answered(answer)}, {"path": "b.obj", "problem": "empty-mesh"}]
    first, second = columns.table(rows).to_pylist()
    kept = {name: value for name, value in first.items() if name not in columns.OWN}
    assert kept == json.loads(to_json(answer, ()))
    assert second["problem"] == "empty-mesh"
    assert {name for name, value in second.items() if value is not None} == {"path", "problem"}


def test_every_member_of_an_answer_has_a_column() -> None:
    members = {field.alias or name for name, field in DetectResponse.model_fields.items()}
    assert set(columns.schema().names) == (members - {"rejected", "bop"}) | set(columns.OWN)
    with pytest.raises(TypeError, match="no column"):
        columns.arrow_type(int | str)


class Square(BaseModel):
    side: float


class Circle(BaseModel):
    kind: str
    radius: float


class Mistaken(BaseModel):
    side: str


def test_a_member_that_is_one_of_several_has_the_members_of_all() -> None:
    kind = columns.arrow_type(list[Square | Circle] | None)
    rows = [[{"side": 1.0}, {"kind": "c", "radius": 2.0}], None]
    assert pa.array(rows, kind).to_pylist() == [
        [{"side": 1.0, "kind": None, "radius": None}, {"side": None, "kind": "c", "radius": 2.0}],
        None,
    ]
    with pytest.raises(TypeError, match="both kinds of side"):
        columns.arrow_type(Square | Mistaken)


NAMES = ["a.ply", "b/x.OBJ", "b/c d/y%20z.stl", "b/c d/s.tar", "b/c d/t.tar.gz", "b/notes.txt", "ünï/é#.off"]


def test_folders_patterns_and_files_of_this_machine(tmp_path: Path) -> None:
    for name in NAMES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"12345")

    def found(location: str) -> list[str]:
        inputs = Store(location).list_inputs()
        assert {item.size for item in inputs} == {5}
        return [Path(item.path).relative_to(tmp_path).as_posix() for item in inputs]

    assert found(str(tmp_path)) == found(f"file://{tmp_path}/") == sorted(set(NAMES) - {"b/notes.txt"})
    assert found(f"{tmp_path}/b/*.OBJ") == ["b/x.OBJ"]
    assert found(f"{tmp_path}/**/*.stl") == ["b/c d/y%20z.stl"]
    assert found(f"{tmp_path}/b/**/?.tar*") == ["b/c d/s.tar", "b/c d/t.tar.gz"]
    assert found(f"{tmp_path}/b/notes.txt") == ["b/notes.txt"]
    assert [item.is_shard for item in Store(f"{tmp_path}/b/c d").list_inputs()] == [True, True, False]
    for nothing in ("missing", "missing/*.obj", "b/*.xyz"):
        with pytest.raises(LocationError, match=r"there (is nothing|are no meshes)"):
            Store(f"{tmp_path}/{nothing}").list_inputs()
    with pytest.raises(LocationError):
        Store("nosuchscheme://a/b")


def test_the_same_in_a_bucket_and_in_what_fsspec_knows() -> None:
    with bucket() as s3:
        s3.put({f"meshes/{name}": b"12345" for name in NAMES})
        store = Store(s3.uri("meshes"))
        expected = [f"s3://{s3.name}/meshes/{name}" for name in sorted(set(NAMES) - {"b/notes.txt"})]
        assert [item.path for item in store.list_inputs()] == expected
        assert [item.path for item in Store(s3.uri("meshes/**/*.stl")).list_inputs()] == [expected[3]]
        for name in expected:
            with store.reading(name) as stream:
                assert stream.read() == b"12345"
        with pytest.raises(LocationError):
            Store(s3.uri("nothing")).list_inputs()
    memory = Store("memory://meshes")
    memory.write("a.obj", b"123")
    (item,) = Store("memory://meshes/*.obj").list_inputs()
    with memory.reading(item.path) as stream:
        assert stream.read() == b"123"
    assert item == Input("memory:///meshes/a.obj", 3)


def test_a_piece_is_written_whole_and_again_in_its_own_place(tmp_path: Path) -> None:
    store = Store(str(tmp_path / "out"))
    results = Results(store)
    results.claim({"mode": "full"})
    for _ in range(2):
        part = Part(store, "a.obj\nb.obj")
        part.add({"path": "a.obj"})
        assert not list((tmp_path / "out").glob("*.parquet")) or results.done().files
        part.add({"path": "s.tar/c.obj", "shard": "s.tar"})
        part.finish()
    assert results.done() == Done(frozenset({"a.obj"}), frozenset({"s.tar"}))
    (file,) = (tmp_path / "out").glob("*.parquet")
    assert parquet.read_table(file).num_rows == 2
    (tmp_path / "out" / "_unfinished-part-0.parquet").write_bytes(b"half of a fi")
    assert len(list(results.rows())) == 2
    results.claim({"mode": "full"})
    with pytest.raises(AnotherRunError, match="answers with mode full, not paper"):
        results.claim({"mode": "paper"})


def test_pieces_cover_what_is_missing_once() -> None:
    inputs = [Input(f"{i:04}.obj", i) for i in range(1000)] + [Input("a.tar", 7), Input("b.tgz", 9)]
    left = missing(inputs, Done(frozenset({"0007.obj", "b.tgz"}), frozenset({"a.tar"})))
    assert {item.path for item in inputs} - {item.path for item in left} == {"0007.obj", "a.tar"}
    cut = pieces(left, workers=2)
    assert sorted(path for piece in cut for path in piece.paths) == sorted(item.path for item in left)
    assert cut[0].paths == ["b.tgz"]
    assert len(cut) > 2 * 8
    assert max(len(piece.paths) for piece in pieces(left, 1, most=1)) == 1


def test_an_input_that_no_actor_survives_gets_a_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from app.bulk import job
    from app.bulk.detecting import Task

    tried: list[int] = []

    def lost(task: Task, planned: list[object], *rest: object) -> int:
        tried.append(len(planned))
        return 0

    monkeypatch.setattr(job, "_work", lost)
    task = Task(str(DATA), str(tmp_path), "full", 4e-4, "auto", None, {})
    inputs = [Input("a.obj", 1), Input("b.obj", 1), Input("c.tar", 1)]
    run(task, inputs, job.Cluster(1, 1, 1, 1), lambda _: None)
    results = Results(Store(str(tmp_path)))
    summary = summarise(results.rows())
    assert dict(summary.problems) == {"worker-lost": 3}
    assert missing(inputs, results.done()) == []
    assert tried == [3, 3]


def test_settings_of_a_task_are_those_of_the_service() -> None:
    from app.bulk.detecting import Task
    from app.settings import Settings

    task = Task("a", "b", "full", 4e-4, "auto", None, Settings(deadline_s=3.0).model_dump(exclude={"api_keys"}))
    assert Settings(**dataclasses.asdict(task)["settings"]).deadline_s == 3.0
