"""Evaluation: figures are the geometry's, methods are told apart, runs resume, one report comes out."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import training.evaluation.evaluate as evaluation
from model.formats.conversion import as_mesh
from model.geometry.frames import UnitFrame
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect, rotation_matrix
from model.meshes.mesh import Mesh
from model.meshes.subdivision import subdivide
from tests import shapes
from training.__main__ import app
from training.evaluation.classical import Refined, Reused
from training.evaluation.command import run
from training.evaluation.corruptions import CorruptedShape, Similarity, cut_ball
from training.evaluation.evaluate import Options, evaluate
from training.evaluation.grouping import render_by
from training.evaluation.judging import _Judge, _Mirrored, _missing_part
from training.evaluation.matching import Found, FoundAxis
from training.evaluation.method import Answer, Method
from training.evaluation.plain import render_plain
from training.evaluation.registry import build, expand
from training.evaluation.report import render, summarise
from training.oracle.known_truth import written_truth
from training.oracle.truth import Truth
from training.shapes.catalogue import write_shapes
from training.shapes.solids import box

FAMILIES = ("box", "pyramid", "prism", "none", "cylinder", "inversion")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("full") / "shapes"
    write_shapes(root, len(FAMILIES), seed=2, only=FAMILIES)
    return root


@dataclass(frozen=True)
class Oracle:
    """Knows the truth: ``full`` says all of it, any other name one plane too many and orders too small."""

    title: str
    truths: dict[tuple[int, int], Truth]

    def __call__(self, mesh: Mesh, seed: Sequence[int]) -> Answer:
        truth = self.truths[len(mesh.faces), mesh.vertices.shape[0]]
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
        planes = [frame.plane_to_input(plane) for plane in truth.planes]
        axes = [FoundAxis(axis.direction, frame.to_input(axis.point), axis.order) for axis in truth.axes]
        if self.title != "full":
            planes.append(frame.plane_to_input(np.array([0.36, 0.48, 0.8, 0.0])))
            axes = [axis._replace(order=axis.order and axis.order // 2 * 2) for axis in axes]
        exact = [True] * (len(planes) + len(axes))
        return Answer(Found(np.array(planes).reshape(-1, 4), axes), {"infer": 2.0}, "?", exact)


@pytest.fixture
def oracle(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    truths = {}
    for path in sorted(folder.glob("*.ply")):
        mesh = as_mesh(path)
        written = written_truth(path, UnitFrame.of(mesh.vertices, mesh.faces))
        assert written is not None
        truths[len(mesh.faces), mesh.vertices.shape[0]] = written[0]

    def methods(names: Sequence[str], max_error: float) -> dict[str, Method]:
        return {name: Oracle(name, truths) for name in names}

    monkeypatch.setattr(evaluation, "build_all", methods)


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
    records = evaluate([folder], Options("clean", ("full", "paper")), progress=False)
    report = summarise(records, 4e-4)
    full, paper = report["methods"]["full"], report["methods"]["paper"]
    assert report["shapes"] == len(FAMILIES)
    assert report["clear"] == len(FAMILIES) - 2  # one has no symmetry, one a centre only
    for figure in ("plane_recall", "dominant_share", "any_share", "axis_recall", "order_recall"):
        assert full[figure] == 1.0
    assert full["angle_p95"] < 1e-6
    assert full["over_threshold"] == full["exact_per_c1"] == 0.0
    assert full["clear_best_mean"] < 1e-12
    assert 0.0 < paper["apart"] < full["apart"] <= 90.0  # the invention is at right angles to nothing
    assert paper["plane_recall"] == paper["axis_recall"] == 1.0
    assert full["mean_precision"] == paper["mean_precision"] == 1.0  # the invention comes last
    assert paper["order_recall"] < 1.0
    assert paper["over_threshold"] > 0.0
    assert paper["exact_per_c1"] == 1.0
    assert full["gte_mean"] < 1e-12
    assert paper["planes"] == pytest.approx(full["planes"] + 1.0)
    text = render(report, "clean", 4e-4)
    assert "| full | 6 | " in text
    assert "infer 2.0" in text
    people = render_plain(report, "clean", 4e-4)
    assert "|" not in people
    assert "infer 2.0" in people
    heading, *rows = people.splitlines()
    assert heading == text.splitlines()[0]
    titles = next(row for row in rows if row.startswith("Best plane"))
    shapes = next(row for row in rows if row.split()[:1] == ["shapes"])
    assert titles.split()[2:] == ["full", "paper"]
    assert shapes.split()[1:] == ["6", "6"]
    # Figures stand below the end of the method's name.
    assert [row.rindex("6") for row in (shapes,)] == [len(titles) - 1]
    recall = next(row for row in rows if row.split()[:2] == ["clear", "planes"])
    assert recall.split()[2:] == ["100.0%", "100.0%"]


@pytest.mark.usefixtures("oracle")
def test_answers_find_their_way_back_from_a_pose(folder: Path):
    records = evaluate([folder], Options("rotated", ("full", "paper")), progress=False)
    # The oracle speaks of the file's own pose: on a turned mesh it is wrong, and that must show.
    report = summarise(records, 4e-4)
    assert report["methods"]["full"]["plane_recall"] < 0.5
    assert report["methods"]["full"]["over_threshold"] > 0.3


def test_real_methods_on_real_damage(folder: Path):
    """PCA is exact on a box in any pose; noise and holes show in the errors of everything."""
    reports = {}
    for damage in ("rotated", "noisy", "partial"):
        records = evaluate([folder], Options(damage=damage, methods=("pca", "pca+refined", "paper")), progress=False)
        reports[damage] = summarise(records, 4e-4)["methods"]
        box = next(record for record in records if "box" in record["name"])
        assert len(box["methods"]["pca"]["planes"]) >= 1
        assert box["methods"]["pca"]["ms"] > 0
        if damage == "rotated":
            assert box["methods"]["pca"]["planes_found"] == [True] * 3
            assert max(box["methods"]["pca"]["plane_sde"]) < 1e-12
        else:
            assert box["shown_faces"] > box["faces"]
            assert box["methods"]["pca+refined"]["fresh_sde"][0] > 1e-9
    assert reports["noisy"]["pca"]["angle_median"] > reports["rotated"]["pca"]["angle_median"]


def test_refined_random_starts_find_every_plane_of_a_prism():
    shape = shapes.as_mesh(shapes.known("prism", n=5))
    found = build("random_planes+refined", 4e-4)(shape, (0, 0)).found
    assert len(found.planes) == 6
    assert not found.axes
    vertices = shape.vertices
    surface = SurfaceIndex(vertices, shape.faces)
    for plane in found.planes:
        assert surface.mean_squared_distance(reflect(vertices, plane)) < 1e-12


def test_validation_leaves_what_is_symmetric():
    shape = shapes.as_mesh(shapes.known("mirror", 3))
    assert len(build("pca", 4e-4)(shape, (0,)).found.planes) == 3
    kept = build("pca+validated", 4e-4)(shape, (0,)).found.planes
    surface, samples = SurfaceIndex(shape.vertices, shape.faces), shape.vertices
    scale = UnitFrame.of(shape.vertices, shape.faces).scale
    assert 1 <= len(kept) < 3
    for plane in kept:
        assert surface.mean_squared_distance(reflect(samples, plane)) < 4e-3 * scale**2


def test_what_follows_a_method_that_has_just_run_takes_its_planes_over_and_counts_their_time():
    calls: list[Mesh] = []

    @dataclass
    class Slow:
        title: str = "slow"

        def __call__(self, mesh: Mesh, seed: Sequence[int]) -> Answer:
            calls.append(mesh)
            return Answer(Found(np.array([[1.0, 0.02, 0.0, 0.0], [0.6, 0.8, 0.0, 0.0]])), reused_ms=1000.0)

    mesh, slow = shapes.box(), Reused(Slow())
    alone, refined = slow(mesh, (0,)), Refined(slow, 4e-4)(mesh, (0,))
    assert len(calls) == 1
    assert len(alone.found.planes) == 2
    np.testing.assert_allclose(np.abs(refined.found.planes[:, :3]), [[1.0, 0.0, 0.0]], atol=1e-6)
    assert refined.reused_ms >= 1000.0
    slow(shapes.box(), (0,))
    slow(shapes.box(), (1,))
    assert len(calls) == 3


@pytest.mark.parametrize(
    "name",
    ["full[network+magic]", "pca:default", "pca+doubled", "unheard-of", "refined", "full+", ""],
)
def test_names_of_no_method_are_refused(name: str):
    with pytest.raises(ValueError, match="there is no method"):
        expand([name])


def test_an_ablation_is_full_mode_with_every_set_of_sources():
    names = expand(["ablation", "pca", "pca"])
    assert len(set(names)) == len(names)
    assert {"full[network]", "full[network+scan]", "full[network+inertia+scan]", "pca"} <= set(names)


def test_recorded_planes_are_judged_beside_on_the_meshes_they_name(folder: Path, tmp_path: Path):
    box = next(path for path in folder.glob("*.ply") if "_box_" in path.name)
    planes = json.loads((folder / "ground_truth.json").read_text())[box.name]["planes"]
    lines = ["mesh,method,plane,nx,ny,nz,offset,time_ms"]
    for row, plane in enumerate(planes[:2]):
        doubled = ",".join(repr(2.0 * number) for number in plane)  # as of one who leaves normals as they come
        lines.append(f"{folder.name}/{box.name},stranger,{row},{doubled},12.5")
    recorded = tmp_path / "planes.csv"
    recorded.write_text("\n".join(lines) + "\n")
    records = evaluate([folder], Options("rotated", ("pca",), recorded=str(recorded)), progress=False)
    assert [Path(record["name"]).name for record in records] == [box.name]
    stranger = summarise(records, 4e-4)["methods"]["recorded stranger"]
    assert stranger["clear_best_mean"] < 1e-12
    assert stranger["plane_recall"] == pytest.approx(2 / 3)
    assert stranger["ms_p50"] == 12.5
    with pytest.raises(ValueError, match="whole shapes"):
        evaluate([folder], Options("noisy", ("pca",), recorded=str(recorded)), progress=False)
    recorded.write_text("mesh,nx\n")
    with pytest.raises(ValueError, match="needs the columns"):
        evaluate([folder], Options("rotated", ("pca",), recorded=str(recorded)), progress=False)


def test_a_true_plane_completes_what_a_ball_took_away():
    mesh = shapes.box()
    vertices, faces = cut_ball(mesh.vertices, mesh.faces, np.random.default_rng(2), hole=0.1)
    whole = UnitFrame.of(mesh.vertices, mesh.faces)
    similarity = Similarity(np.eye(3), whole.center, whole.scale)
    frame = UnitFrame.of(vertices, faces)
    seen = _Judge(frame.to_unit(vertices), faces, 500, 0)
    samples, _ = sample_surface(whole.to_unit(mesh.vertices), mesh.faces, 4000, seed=1)
    error = _missing_part(samples, CorruptedShape(vertices, faces, similarity), frame, seen)
    errors = [error(plane) for plane in np.eye(3, 4)]
    tilted = error(np.array([np.cos(0.1), np.sin(0.1), 0.0, 0.0]))
    assert min(value for value in errors if value is not None) < 1e-9
    assert tilted is not None
    assert tilted > 1e-3
    nothing = _missing_part(
        samples,
        CorruptedShape(mesh.vertices, mesh.faces, similarity),
        whole,
        _Judge(whole.to_unit(mesh.vertices), mesh.faces, 500, 0),
    )
    assert nothing(np.eye(3, 4)[0]) is None


def test_half_a_box_is_completed_by_its_plane_and_by_no_other():
    vertices, faces = box((2.0, 2.0, 2.0))
    intact = Mesh.checked(*subdivide(vertices, faces, 0.1))
    whole = UnitFrame.of(intact.vertices, intact.faces)
    kept = intact.faces[intact.vertices[intact.faces][..., 0].max(1) <= 1e-9]
    shown = CorruptedShape(intact.vertices, kept, Similarity(np.eye(3), whole.center, whole.scale))
    frame = UnitFrame.of(shown.vertices, shown.faces)
    judges = (
        _Judge(whole.to_unit(intact.vertices), intact.faces, 2000, 0),
        _Judge(frame.to_unit(shown.vertices), shown.faces, 2000, 1),
    )
    mirrored = _Mirrored(*judges, shown, frame)
    assert mirrored.there(np.zeros((0, 4))) == pytest.approx(0.5, abs=0.05)
    assert mirrored.wrong(np.zeros((0, 4))) == 0.0
    right, across, beside = np.eye(3, 4)[:1], np.eye(3, 4)[1:2], np.array([[1.0, 0.0, 0.0, -0.1]])
    assert (mirrored.there(right), mirrored.wrong(right)) == (1.0, 0.0)
    assert mirrored.there(across) == mirrored.there(np.zeros((0, 4)))  # maps the half to itself
    assert mirrored.wrong(across) == 0.0
    # Moved by a twentieth of the box: the far side lands outside, the others slide along themselves, less a gap.
    near = 0.02 * 2.0 * np.sqrt(3.0)
    assert mirrored.there(beside) == pytest.approx(0.5 + 8 * (0.8 + 3 * near) / 24, abs=0.04)
    assert mirrored.wrong(beside) == pytest.approx((4 + 8 * (0.2 - near)) / 12, abs=0.04)


def test_only_symmetric_shapes_are_drawn_when_asked(folder: Path):
    records = evaluate([folder], Options("clean", ("pca",), symmetric=True), progress=False)
    assert len(records) == len(FAMILIES) - 2
    assert all(record["clear_planes"] for record in records)
    chosen = evaluate([folder], Options("clean", ("pca",), words=("box", "prism")), progress=False)
    assert len(chosen) == 2


def test_ground_truth_beside_the_meshes_is_used(tmp_path: Path):
    """PCA meets the written planes of a box; wrong ones would be believed too."""
    write_shapes(tmp_path / "shapes", 2, seed=1, only=("box",))

    def angle() -> float:
        records = evaluate([tmp_path / "shapes"], Options("rotated", ("pca",)), progress=False)
        return summarise(records, 4e-4)["methods"]["pca"]["gte_angle"]

    assert angle() < 1e-3
    truth = tmp_path / "shapes" / "ground_truth.json"
    entries = json.loads(truth.read_text())
    for entry in entries.values():
        entry["planes"], entry["axes"] = [[0.6, 0.0, 0.8, 0.0]], []
    truth.write_text(json.dumps(entries))
    assert angle() > 1.0


def without_times(records: list[dict[str, Any]]) -> list[dict[str, Any]]:
    timeless = [
        {
            name: {key: value for key, value in answer.items() if key != "ms"}
            for name, answer in record["methods"].items()
        }
        for record in records
    ]
    return [record | {"methods": methods} for record, methods in zip(records, timeless, strict=True)]


@pytest.mark.usefixtures("oracle")
def test_an_interrupted_run_goes_on_where_it_was(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    options, part = Options("clean", ("full",)), tmp_path / "out.part"
    whole = without_times(evaluate([folder], options, resume=part, progress=False))
    lines = part.read_text().splitlines()
    assert len(lines) == 1 + len(FAMILIES)
    part.write_text("\n".join(lines[:4]) + "\n" + lines[4][:20])  # cut off in the middle of a record
    judged: list[str] = []
    original = evaluation._judge_file

    def counted(job: evaluation._Job) -> dict[str, object]:
        judged.append(job.source.name)
        return original(job)

    monkeypatch.setattr(evaluation, "_judge_file", counted)
    assert without_times(evaluate([folder], options, resume=part, progress=False)) == whole
    assert len(judged) == len(FAMILIES) - 3
    evaluate([folder], Options("clean", ("full",), seed=1), resume=part, progress=False)
    assert len(judged) == 2 * len(FAMILIES) - 3  # other options: nothing is taken over


@pytest.mark.usefixtures("oracle")
def test_tables_by_source_and_by_a_column(folder: Path, tmp_path: Path):
    records = evaluate([folder], Options("clean", ("full",)), progress=False)
    groups = {record["name"]: "even" if record["faces"] % 4 == 0 else "odd" for record in records}
    text = render_by(records, groups, lambda members: render(summarise(members, 4e-4), "clean", 4e-4))
    assert text.count("| method |") == 2 * len(set(groups.values()))
    manifest = tmp_path / "manifest.csv"
    manifest.write_text("path,kind\n" + "".join(f"{record['name']},toy\n" for record in records[1:]))
    out = tmp_path / "out.json"
    text = run([folder], Options("clean", ("full",)), by="kind", manifest=manifest, json_file=out, progress=False)
    assert "### toy" in text
    assert "### (not in the manifest)" in text
    document = json.loads(out.read_text())
    assert document["figures"]["shapes"] == len(FAMILIES)
    assert [record["name"] for record in document["shapes"]] == [record["name"] for record in records]
    assert not (tmp_path / "out.json.part").exists()


def test_a_broken_file_is_skipped_and_counted(folder: Path, tmp_path: Path):
    root = tmp_path / "meshes"
    root.mkdir()
    (root / "broken.ply").write_bytes(b"ply\nnothing")
    with pytest.raises(ValueError, match="no shape could be judged"):
        summarise(evaluate([root], Options(methods=("pca",)), progress=False), 4e-4)


def invoke(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["evaluate", "--no-progress", *map(str, arguments)])


def test_the_command_prints_one_table(folder: Path):
    result = invoke(folder, "--methods", "pca+refined", "--limit", 3, "--damage", "rotated")
    assert result.exit_code == 0, result.output
    assert "3 shapes, rotated" in result.output
    assert "PCA + refinement\n" in result.output
    assert "|" not in result.output
    result = invoke(folder, "--methods", "pca+refined", "--limit", 3, "--damage", "rotated", "--markdown")
    assert "| PCA + refinement | 3 |" in result.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--methods", "magic"), "there is no method"),
        (("--damage", "rust"), "damage is one of"),
        (("--by", "kind"), "need --manifest"),
    ],
)
def test_mistakes_end_with_a_sentence_and_status_2(folder: Path, arguments: tuple[str, ...], message: str):
    result = invoke(folder, *arguments)
    assert result.exit_code == 2
    assert message in " ".join(result.output.replace("│", " ").split())
