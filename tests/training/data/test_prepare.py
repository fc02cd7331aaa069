"""Preparation: what is found, what is written, what is skipped, and that it can be resumed."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from model.formats.conversion import as_mesh as read
from model.geometry.frames import UnitFrame
from model.geometry.surface import SurfaceIndex
from model.geometry.voxels import voxelize
from tests.shapes import box
from tests.training.conftest import SMALL, write_obj
from training.data import prepare as module
from training.data.prepare import Options, prepare
from training.data.prepared import PreparedSet, dequantise, quantise
from training.layouts import find_meshes


def test_arrays_describe_the_shape_they_come_from(mesh_folder: Path, prepared: PreparedSet):
    assert len(prepared) == 16 * len(SMALL)
    starts = prepared.arrays("starts")[0]
    arrays = {name: prepared.arrays(name)[0] for name in ("vertices", "faces", "samples", "voxels", "closest")}
    ticks = (np.arange(32) + 0.5) / 32 - 0.5
    centres = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    for index in (0, 17, 95):
        record = prepared.shapes[index]
        mesh = read(mesh_folder.parent / record.name)
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
        true = frame.to_unit(mesh.vertices)[mesh.faces]
        (v0, f0), (v1, f1) = starts[index], starts[index + 1]
        vertices = dequantise(arrays["vertices"][v0:v1]).astype(float)
        faces = np.array(arrays["faces"][f0:f1])
        assert (record.vertices, record.faces, record.category) == (
            len(vertices),
            len(faces),
            Path(record.name).parts[1],
        )
        np.testing.assert_allclose(vertices[faces], true, atol=1e-5)
        surface = SurfaceIndex(vertices, faces)
        samples = dequantise(arrays["samples"][index]).astype(float)
        assert surface.squared_distances(samples).max() < (3e-5) ** 2
        occupied = np.unpackbits(arrays["voxels"][index]).astype(bool).reshape(32, 32, 32)
        np.testing.assert_array_equal(occupied, voxelize(vertices, faces, 32))
        closest = dequantise(arrays["closest"][index]).astype(float)
        exact = np.sqrt(surface.squared_distances(centres))
        np.testing.assert_allclose(np.linalg.norm(closest - centres, axis=1), exact, atol=4e-5)


def test_stored_samples_are_in_random_order(prepared: PreparedSet):
    samples = dequantise(prepared.arrays("samples")[0][0])
    assert np.linalg.norm(samples[:200].mean(0)) < 0.1
    assert np.linalg.norm(samples[-200:].mean(0)) < 0.1


def test_quantisation_is_finer_than_any_threshold():
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (1000, 3))
    assert np.abs(dequantise(quantise(points)) - points).max() < 1e-5


def test_unreadable_files_are_listed_and_skipped(tmp_path: Path):
    write_obj(tmp_path / "in" / "good.obj", box().vertices, box().faces)
    (tmp_path / "in" / "broken.stl").write_bytes(b"solid nothing")
    (tmp_path / "in" / "empty.ply").write_bytes(b"")
    (tmp_path / "in" / "readme.txt").write_text("not a mesh")
    summary = prepare([tmp_path / "in"], tmp_path / "out", Options(mesh_only=True), progress=False)
    assert (summary.shapes, summary.skipped) == (1, 2)
    with (tmp_path / "out" / "skipped.csv").open(newline="") as lines:
        skipped = {row["name"]: row["reason"] for row in csv.DictReader(lines)}
    assert set(skipped) == {"in/broken.stl", "in/empty.ply"}
    assert all(skipped.values())
    assert [shape.name for shape in PreparedSet(tmp_path / "out").shapes] == ["in/good.obj"]


def test_an_interrupted_preparation_goes_on_and_ends_the_same(
    mesh_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(module, "SHARD_SHAPES", 20)
    options = Options(mesh_only=True)
    whole = prepare([mesh_folder], tmp_path / "whole", options, progress=False)
    prepare([mesh_folder], tmp_path / "again", options, progress=False)
    for shard in ("shard-00001", "shard-00004"):
        (tmp_path / "again" / shard / "record.json").unlink()  # as if it had been killed while writing
    untouched = tmp_path / "again" / "shard-00000" / "vertices.npy"
    stamp = untouched.stat().st_mtime_ns
    resumed = prepare([mesh_folder], tmp_path / "again", options, progress=False)
    assert resumed == whole
    assert untouched.stat().st_mtime_ns == stamp


def test_processes_change_nothing(mesh_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "SHARD_SHAPES", 50)
    options = Options(mesh_only=True)
    one = prepare([mesh_folder], tmp_path / "one", options, workers=1, progress=False)
    two = prepare([mesh_folder], tmp_path / "two", options, workers=2, progress=False)
    assert one == two


def test_other_files_do_not_mix_with_a_begun_set(mesh_folder: Path, tmp_path: Path):
    prepare([mesh_folder / "box"], tmp_path / "out", Options(mesh_only=True), progress=False)
    with pytest.raises(ValueError, match="other files or options"):
        prepare([mesh_folder], tmp_path / "out", Options(mesh_only=True), progress=False)


def test_nothing_to_prepare_is_said(tmp_path: Path):
    with pytest.raises(ValueError, match="no mesh"):
        find_meshes([tmp_path])
    with pytest.raises(ValueError, match="not a folder"):
        find_meshes([tmp_path / "missing"])


def test_the_split_depends_on_names_alone(prepared: PreparedSet):
    train, held_out = prepared.split(0.25)
    assert sorted([*train, *held_out]) == list(range(len(prepared)))
    assert 0.1 < len(held_out) / len(prepared) < 0.4
    again, _ = prepared.split(0.25)
    np.testing.assert_array_equal(train, again)
    fewer = set(prepared.split(0.1)[1].tolist())
    assert fewer <= set(held_out.tolist())


def test_a_set_of_another_version_is_refused(prepared: PreparedSet, tmp_path: Path):
    with pytest.raises(ValueError, match="no prepared set"):
        PreparedSet(tmp_path)
    shutil.copytree(prepared.root, tmp_path / "copy")
    manifest = tmp_path / "copy" / "manifest.json"
    manifest.write_text(json.dumps({**json.loads(manifest.read_text()), "version": 99}))
    with pytest.raises(ValueError, match="another version"):
        PreparedSet(tmp_path / "copy")
