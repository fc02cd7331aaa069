"""The evaluation of full mode: figures are the geometry's, methods are told apart, runs resume, tables come out."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import training.evaluation.full_evaluation as full_evaluation
import training.evaluation.full_methods as full_methods
from model.formats.conversion import as_mesh
from model.geometry.frames import UnitFrame
from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect, rotation_matrix
from model.meshes.mesh import Mesh
from tests import shapes
from training.__main__ import app
from training.evaluation.full_command import run
from training.evaluation.full_evaluation import Options, evaluate
from training.evaluation.full_methods import Answer
from training.evaluation.full_report import render, summarise
from training.evaluation.grouping import render_by
from training.evaluation.matching import Found, FoundAxis
from training.oracle.known_truth import written_truth
from training.shapes.catalogue import write_shapes

FAMILIES = ("box", "pyramid", "prism", "none", "cylinder", "inversion")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("full") / "shapes"
    write_shapes(root, len(FAMILIES), seed=2, only=FAMILIES)
    return root


@pytest.fixture
def oracle(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Methods that know the truth: ``full`` says all of it, ``paper`` one plane too many and orders too small."""
    truths = {}
    for path in sorted(folder.glob("*.ply")):
        mesh = as_mesh(path)
        written = written_truth(path, UnitFrame.of(mesh.vertices, mesh.faces))
        assert written is not None
        truths[len(mesh.faces), mesh.vertices.shape[0]] = written[0]

    def answer(method: str, weights: str, mesh: Mesh, max_error: float, seed: object) -> Answer:
        truth = truths[len(mesh.faces), mesh.vertices.shape[0]]
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
        planes = [frame.plane_to_input(plane) for plane in truth.planes]
        axes = [FoundAxis(axis.direction, frame.to_input(axis.point), axis.order) for axis in truth.axes]
        if method == "paper":
            planes.append(frame.plane_to_input(np.array([0.36, 0.48, 0.8, 0.0])))
            axes = [axis._replace(order=axis.order and axis.order // 2 * 2) for axis in axes]
        exact = [True] * (len(planes) + len(axes))
        return Answer(Found(np.array(planes).reshape(-1, 4), axes), 10.0 * len(mesh.faces), {"infer": 2.0}, "?", exact)

    monkeypatch.setattr(full_evaluation, "answer", answer)


def test_written_truth_is_symmetric_in_the_unit_frame(folder: Path):
    for path in folder.glob("*.ply"):
        mesh = as_mesh(path)
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
        written = written_truth(path, frame)
        assert written is not None
        truth, group = written
        assert f"_{group}." in path.name
        vertices = frame.to_unit(mesh.vertices)
        surface = SurfaceIndex(vertices, mesh.faces)
        for plane, continuous in zip(truth.planes, truth.plane_continuous, strict=True):
            limit = 1e-5 if continuous else 1e-20  # a cylinder is a prism of many sides
            assert surface.mean_squared_distance(reflect(vertices, plane)) < limit
        for axis in truth.axes:
            turn = rotation_matrix(axis.direction, 2.0 * np.pi / (axis.order or 7))
            image = (vertices - axis.point) @ turn.T + axis.point
            assert surface.mean_squared_distance(image) < (1e-20 if axis.order else 1e-5)
        assert truth.plane_continuous.sum() == (2 if group == "Dinfh" else 0)
    assert written_truth(folder / "unheard-of.ply", frame) is None


@pytest.mark.usefixtures("oracle")
def test_an_oracle_gets_full_marks_and_its_inventions_are_seen(folder: Path):
    records = evaluate([folder], Options(methods=("full", "paper")), progress=False)
    report = summarise(records, 4e-4)
    full, paper = report["methods"]["full"], report["methods"]["paper"]
    assert report["shapes"] == len(FAMILIES)
    assert report["clear"] == len(FAMILIES) - 2  # one has no symmetry, one a centre only
    for figure in ("plane_recall", "dominant_share", "any_share", "axis_recall", "order_recall"):
        assert full[figure] == 1.0
    assert full["angle_p95"] < 1e-6
    assert full["over_threshold"] == full["exact_per_c1"] == 0.0
    assert full["best_clear_mean"] < 1e-12
    assert paper["plane_recall"] == paper["axis_recall"] == 1.0
    assert paper["order_recall"] < 1.0
    assert paper["over_threshold"] > 0.0
    assert paper["exact_per_c1"] == 1.0
    faces = [record["faces"] for record in records]
    assert full["ms_p50"] == pytest.approx(10.0 * np.median(faces))
    table = render(report, "clean")
    assert "| full mode | 6 | 100.0% | 100.0% |" in table
    assert "infer 2.0" in table


@pytest.mark.usefixtures("oracle")
def test_answers_find_their_way_back_from_a_pose(folder: Path):
    records = evaluate([folder], Options(damage="rotated", methods=("full", "paper")), progress=False)
    # The oracle speaks of the file's own pose: on a turned mesh it is wrong, and that must show.
    report = summarise(records, 4e-4)
    assert report["methods"]["full"]["plane_recall"] < 0.5
    assert report["methods"]["full"]["over_threshold"] > 0.3


def test_real_methods_on_real_damage(folder: Path):
    """PCA is exact on a box in any pose; noise and holes show in the errors of everything."""
    reports = {}
    for damage in ("rotated", "noisy", "partial"):
        records = evaluate([folder], Options(damage=damage, methods=("pca", "paper")), progress=False)
        reports[damage] = summarise(records, 4e-4)["methods"]
        box = next(record for record in records if "box" in record["name"])
        assert len(box["methods"]["pca"]["planes"]) >= 1
        assert box["methods"]["pca"]["ms"] > 0
        if damage == "rotated":
            assert box["methods"]["pca"]["planes_found"] == [True] * 3
            assert max(box["methods"]["pca"]["plane_sde"]) < 1e-12
        else:
            assert box["shown_faces"] > box["faces"]
            assert box["methods"]["pca"]["fresh_sde"][0] > 1e-9
    assert reports["noisy"]["pca"]["angle_median"] > reports["rotated"]["pca"]["angle_median"]


def test_refined_random_starts_find_every_plane_of_a_prism():
    shape = shapes.as_mesh(shapes.known("prism", n=5))
    answer = full_methods.answer("random", "default", shape, 4e-4, (0, 0))
    assert len(answer.found.planes) == 6
    assert not answer.found.axes
    assert answer.milliseconds > 0
    vertices = shape.vertices
    surface = SurfaceIndex(vertices, shape.faces)
    for plane in answer.found.planes:
        assert surface.mean_squared_distance(reflect(vertices, plane)) < 1e-12


@pytest.mark.usefixtures("oracle")
def test_an_interrupted_run_goes_on_where_it_was(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    options, part = Options(methods=("full",)), tmp_path / "out.part"
    whole = evaluate([folder], options, resume=part, progress=False)
    lines = part.read_text().splitlines()
    assert len(lines) == 1 + len(FAMILIES)
    part.write_text("\n".join(lines[:4]) + "\n" + lines[4][:20])  # cut off in the middle of a record
    judged: list[str] = []
    original = full_evaluation._judge_file

    def counted(job: full_evaluation._Job) -> dict[str, object]:
        judged.append(job.source.name)
        return original(job)

    monkeypatch.setattr(full_evaluation, "_judge_file", counted)
    assert evaluate([folder], options, resume=part, progress=False) == whole
    assert len(judged) == len(FAMILIES) - 3
    evaluate([folder], Options(methods=("full",), seed=1), resume=part, progress=False)
    assert len(judged) == 2 * len(FAMILIES) - 3  # other options: nothing is taken over


@pytest.mark.usefixtures("oracle")
def test_tables_by_source_and_by_a_column(folder: Path, tmp_path: Path):
    records = evaluate([folder], Options(methods=("full",)), progress=False)
    groups = {record["name"]: "even" if record["faces"] % 4 == 0 else "odd" for record in records}
    text = render_by(records, groups, lambda members: render(summarise(members, 4e-4), "clean"))
    assert text.count("| method |") == len(set(groups.values()))
    manifest = tmp_path / "manifest.csv"
    manifest.write_text("path,kind\n" + "".join(f"{record['name']},toy\n" for record in records[1:]))
    out = tmp_path / "out.json"
    text = run([folder], Options(methods=("full",)), by="kind", manifest=manifest, json_file=out, progress=False)
    assert "### toy" in text
    assert "### (not in the manifest)" in text
    document = json.loads(out.read_text())
    assert document["figures"]["shapes"] == len(FAMILIES)
    assert [record["name"] for record in document["shapes"]] == [record["name"] for record in records]
    assert not (tmp_path / "out.json.part").exists()


@pytest.mark.usefixtures("oracle")
def test_the_exhaustive_search_gets_a_random_part(folder: Path):
    options = Options(methods=("full", "exhaustive"), exhaustive_limit=2)
    records = evaluate([folder], options, limit=5, progress=False)
    assert len(records) == 5
    assert sum("exhaustive" in record["methods"] for record in records) == 2
    assert summarise(records, 4e-4)["methods"]["exhaustive"]["shapes"] == 2


def test_a_broken_file_is_skipped_and_counted(folder: Path, tmp_path: Path):
    root = tmp_path / "meshes"
    root.mkdir()
    (root / "broken.ply").write_bytes(b"ply\nnothing")
    with pytest.raises(ValueError, match="no shape could be judged"):
        summarise(evaluate([root], Options(methods=("pca",)), progress=False), 4e-4)


def invoke(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["evaluate", "--no-progress", "--mode", "full", *map(str, arguments)])


def test_the_command_prints_one_table(folder: Path):
    result = invoke(folder, "--methods", "pca", "--limit", 3, "--damage", "rotated")
    assert result.exit_code == 0, result.output
    assert "| PCA + refinement | 3 |" in result.output
    assert "3 shapes, rotated" in result.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--methods", "magic"), "there is no method"),
        (("--damage", "rust"), "damage is one of"),
        (("--by", "kind"), "need --manifest"),
        (("--weights", "default", "--weights", "paper"), "one set of weights"),
    ],
)
def test_mistakes_end_with_a_sentence_and_status_2(folder: Path, arguments: tuple[str, ...], message: str):
    result = invoke(folder, *arguments)
    assert result.exit_code == 2
    assert message in " ".join(result.output.replace("│", " ").split())
