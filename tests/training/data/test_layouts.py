"""Every published layout is recognised on a small tree written here: names, categories, splits, licences, geometry."""

import csv
import io
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from model.errors import MeshError
from model.meshes.mesh import Mesh
from tests.shapes import box
from tests.training.conftest import write_obj
from training.__main__ import app
from training.data.prepare import Options, prepare
from training.data.prepared import PreparedSet
from training.layouts import find_meshes, parse

CUBOID = box()


def write_off(path: Path, mesh: Mesh, head: str = "OFF\n") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [f"{head}{len(mesh.vertices)} {len(mesh.faces)} 0"]
    lines += [f"{x} {y} {z}" for x, y, z in mesh.vertices]
    lines += [f"3 {a} {b} {c}" for a, b, c in mesh.faces]
    path.write_text("\n".join(lines) + "\n")


def write_stl(path: Path, mesh: Mesh) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    facets = np.zeros(len(mesh.faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("extra", "<u2")])
    facets["corners"] = mesh.vertices[mesh.faces]
    path.write_bytes(bytes(80) + np.uint32(len(facets)).tobytes() + facets.tobytes())


def write_rows(path: Path, rows: list[dict[str, str]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as lines:
        out = csv.DictWriter(lines, list(rows[0]))
        out.writeheader()
        out.writerows(rows)


def prepared_sizes(root: Path, out: Path) -> set[tuple[int, int]]:
    """Prepare everything and check that it is the cuboid: its vertices in the unit frame lie on a sphere."""
    summary = prepare([root], out, Options(mesh_only=True), progress=False)
    assert summary.skipped == 0
    prepared = PreparedSet(out)
    points = np.array(prepared.arrays("vertices")[0], dtype=float) / 65535 - 0.5
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 0.5, atol=1e-4)
    return {(shape.vertices, shape.faces) for shape in prepared.shapes}


def test_shapenet_with_its_official_split(tmp_path: Path):
    root = tmp_path / "ShapeNetCore.v2"
    models = [
        ("02691156", "1a04e3eab45ca15dd86060f189eb133"),
        ("02691156", "2b"),
        ("03001627", "3c"),
        ("03001627", "4"),
    ]
    for synset, model in models:
        write_obj(root / synset / model / "models" / "model_normalized.obj", CUBOID.vertices, CUBOID.faces)
        write_obj(root / synset / model / "models" / "other.obj", CUBOID.vertices, CUBOID.faces)
        (root / synset / model / "models" / "model_normalized.mtl").write_text("newmtl x\n")
    # The published file has dropped the leading zeros; the last model is not listed.
    write_rows(root / "all.csv", [
        {"id": str(number), "synsetId": synset.lstrip("0"), "subSynsetId": synset.lstrip("0"), "modelId": model,
         "split": split}
        for number, ((synset, model), split) in enumerate(zip(models, ("train", "test", "val"), strict=False))
    ])  # fmt: skip
    found = find_meshes([root])
    assert [source.name for source in found] == ["/".join(model) for model in models]
    assert [source.split for source in found] == ["train", "test", "val", ""]
    assert [source.category for source in found] == [synset for synset, _ in models]
    assert {source.source for source in found} == {"ShapeNetCore.v2"}
    for split, model in zip(("train", "test", "val"), models, strict=False):
        assert [source.name for source in find_meshes([root], split=split)] == ["/".join(model)]
    assert prepared_sizes(root, tmp_path / "out") == {(8, 12)}


@pytest.mark.parametrize("name", ["ModelNet10", "ModelNet40"])
def test_modelnet_with_its_malformed_headers(tmp_path: Path, name: str):
    root = tmp_path / name
    write_off(root / "chair" / "train" / "chair_0001.off", CUBOID)
    write_off(root / "chair" / "test" / "chair_0890.off", CUBOID, head="OFF")  # "OFF8 12 0" on one line
    write_off(root / "night_stand" / "train" / "night_stand_0001.off", CUBOID, head="OFF")
    (root / "README.txt").write_text("ModelNet\n")
    found = find_meshes([root])
    assert [(source.name, source.category, source.split) for source in found] == [
        (f"{name}/chair/test/chair_0890.off", "chair", "test"),
        (f"{name}/chair/train/chair_0001.off", "chair", "train"),
        (f"{name}/night_stand/train/night_stand_0001.off", "night_stand", "train"),
    ]
    assert {source.source for source in found} == {name}
    assert len(find_meshes([root], split="train")) == 2
    assert prepared_sizes(root, tmp_path / "out") == {(8, 12)}


@pytest.mark.parametrize("chunks", [("",), ("abc_0000_obj_v00", "abc_0001_obj_v00")])
def test_abc_chunks(tmp_path: Path, chunks: tuple[str, ...]):
    root = tmp_path / "abc"
    for number, chunk in enumerate(chunks):
        for index in (2 * number, 2 * number + 1):
            model = f"{index:08d}"
            write_obj(
                root / chunk / model / f"{model}_290a9120f9f249a7a05cfe9c_trimesh_000.obj",
                CUBOID.vertices,
                CUBOID.faces,
            )
            (root / chunk / model / f"{model}_290a9120f9f249a7a05cfe9c_features_000.yml").write_text("curves: []\n")
        (root / chunk / f"{2 * number + 2:08d}").mkdir()  # some numbers have no model
    found = find_meshes([root])
    assert len(found) == 2 * len(chunks)
    assert found[0].name.startswith("/".join(filter(None, ("abc", chunks[0], "00000000", "00000000_290a"))))
    # A folder of its own for each model is no category.
    assert {(source.source, source.category, source.split) for source in found} == {("ABC", "", "")}
    with pytest.raises(ValueError, match="no mesh below the given folders belongs to the split 'train'"):
        find_meshes([root], split="train")
    assert prepared_sizes(root, tmp_path / "out") == {(8, 12)}


def thingi_tables(folder: Path) -> None:
    link = "https://www.thingiverse.com/download:"
    write_rows(folder / "input_summary.csv", [
        {"ID": "32770", "Thing ID": "10955", "Link": f"{link}32770.stl"},
        {"ID": "34785", "Thing ID": "11622", "Link": f"{link}34785.obj"},
    ])  # fmt: skip
    write_rows(folder / "contextual_data.csv", [
        {"Thing ID": "10955", "Category": "Mechanical Parts", "Sub-category": "Gears", "Name": "Gear", "Author": "A",
         "License": "Creative Commons - Attribution"},
        {"Thing ID": "11622", "Category": "None", "Sub-category": "None", "Name": "Cup", "Author": "B",
         "License": "Public Domain Dedication"},
    ])  # fmt: skip


@pytest.mark.parametrize("start", [".", "Thingi10K", "Thingi10K/raw_meshes"])
def test_thingi10k_as_it_was_uploaded(tmp_path: Path, start: str):
    root = tmp_path / "download"
    write_stl(root / "Thingi10K" / "raw_meshes" / "32770.stl", CUBOID)
    write_obj(root / "Thingi10K" / "raw_meshes" / "34785.obj", CUBOID.vertices, CUBOID.faces)
    thingi_tables(root / "Thingi10K" / "metadata")
    found = find_meshes([root / start])
    assert [(source.name, source.source, source.category, source.licence) for source in found] == [
        ("Thingi10K/32770", "Thingi10K", "Mechanical Parts", "Creative Commons - Attribution"),
        ("Thingi10K/34785", "Thingi10K", "", "Public Domain Dedication"),
    ]
    assert prepared_sizes(root, tmp_path / "out") == {(36, 12), (8, 12)}


def test_thingi10k_as_arrays(tmp_path: Path):
    root = tmp_path / "Thingi10K_npz"
    (root / "npz").mkdir(parents=True)
    np.savez(root / "npz" / "32770.npz", vertices=CUBOID.vertices, facets=CUBOID.faces)
    np.savez(root / "npz" / "34785.npz", vertices=CUBOID.vertices.astype(np.float32), facets=CUBOID.faces[:, ::-1])
    thingi_tables(root / "metadata")
    found = find_meshes([root])
    assert [source.name for source in found] == ["Thingi10K/32770", "Thingi10K/34785"]
    assert found[0].licence == "Creative Commons - Attribution"
    assert prepared_sizes(root, tmp_path / "out") == {(8, 12)}
    licences = [shape.licence for shape in PreparedSet(tmp_path / "out").shapes]
    assert licences == ["Creative Commons - Attribution", "Public Domain Dedication"]


@pytest.mark.parametrize(
    "arrays",
    [
        {"vertices": CUBOID.vertices},
        {"vertices": CUBOID.vertices, "facets": np.zeros((3, 4), dtype=int)},
        {"vertices": CUBOID.vertices, "facets": np.array([[0, 1, 99]])},
        {"vertices": np.array([{}], dtype=object), "facets": CUBOID.faces},
        None,
    ],
)
def test_damaged_arrays_are_refused(arrays: dict[str, np.ndarray] | None):
    data = io.BytesIO()
    if arrays is not None:
        np.savez(data, **arrays)
    with pytest.raises(MeshError):
        parse(data.getvalue() or b"PK\x03\x04 no archive", "1.npz")


def test_plain_folders_with_a_manifest(tmp_path: Path):
    root = tmp_path / "mine"
    for name in ("a/one.obj", "a/two.obj", "three.obj"):
        write_obj(root / name, CUBOID.vertices, CUBOID.faces)
    plain = find_meshes([root])
    assert [(s.name, s.source, s.category, s.licence) for s in plain] == [
        ("mine/a/one.obj", "mine", "a", ""), ("mine/a/two.obj", "mine", "a", ""), ("mine/three.obj", "mine", "", ""),
    ]  # fmt: skip
    rows = [
        {"path": "a/one.obj", "source": "museum", "category": "chair", "licence": "CC0", "split": "train", "up": "y"},
        {"path": "three.obj", "source": "", "category": "lamp", "licence": "CC-BY-4.0", "split": "test", "up": "z"},
    ]
    write_rows(root / "manifest.csv", rows)
    described = find_meshes([root])
    # A manifest never changes names, and what it leaves out stays as it was.
    assert [source.name for source in described] == [source.name for source in plain]
    assert [(s.source, s.category, s.licence, s.split) for s in described] == [
        ("museum", "chair", "CC0", "train"), ("mine", "a", "", ""), ("mine", "lamp", "CC-BY-4.0", "test"),
    ]  # fmt: skip
    prepare([root], tmp_path / "out", Options(mesh_only=True), progress=False, split="train")
    prepared = PreparedSet(tmp_path / "out")
    assert [(shape.name, shape.licence, shape.split) for shape in prepared.shapes] == [
        ("mine/a/one.obj", "CC0", "train")
    ]
    assert prepared.record()["licences"] == {"CC0": 1}


def test_a_manifest_elsewhere_is_named(tmp_path: Path):
    write_obj(tmp_path / "corpus" / "train" / "x" / "one.obj", CUBOID.vertices, CUBOID.faces)
    listing = tmp_path / "manifest.csv"
    write_rows(listing, [{"path": "train/x/one.obj", "source": "x", "license": "MIT"}])
    start = ["prepare", str(tmp_path / "corpus" / "train"), "-o", str(tmp_path / "out"), "--mesh-only", "--no-progress"]
    result = CliRunner().invoke(app, [*start, "--manifest", str(listing)])
    assert result.exit_code == 0, result.output
    shape = PreparedSet(tmp_path / "out").shapes[0]
    assert (shape.name, shape.source, shape.licence) == ("train/x/one.obj", "x", "MIT")
    for rows, message in (
        ([{"path": "elsewhere.obj", "source": "x"}], "no path in"),
        ([{"file": "one.obj"}], "no column path"),
    ):
        write_rows(listing, rows)
        result = CliRunner().invoke(app, [*start, "--manifest", str(listing)])
        assert result.exit_code == 2
        assert message in " ".join(result.output.replace("│", " ").split())


def test_a_set_without_licences_keeps_its_hash(tmp_path: Path, mesh_folder: Path):
    """The hash of a set prepared before licences were known: names, sizes and arrays alone go into it."""
    bare = prepare([mesh_folder / "box"], tmp_path / "bare", Options(mesh_only=True), progress=False)
    listing = tmp_path / "m.csv"
    write_rows(listing, [{"path": f"{index:02d}.obj", "licence": "CC0"} for index in range(16)])
    known = prepare(
        [mesh_folder / "box"], tmp_path / "known", Options(mesh_only=True), progress=False, manifest=listing
    )
    assert bare.sha256 != known.sha256
    # As /data sets of version 0.1 have it: no such column.
    path = tmp_path / "bare" / "shapes.csv"
    with path.open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    write_rows(path, [{key: row[key] for key in ("name", "source", "category", "vertices", "faces")} for row in rows])
    old = PreparedSet(tmp_path / "bare")
    assert {shape.licence for shape in old.shapes} == {""}
    assert set(old.record()) == {"manifest_sha256", "shapes", "skipped"}
