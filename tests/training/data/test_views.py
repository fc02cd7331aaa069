"""Pieces of shapes, and from where they are seen: what `training views` writes, and what training makes of it."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from model.geometry.frames import UnitFrame, triangle_areas
from model.geometry.normals import face_normals
from tests.shapes import box
from training.data.prepare import Options, prepare
from training.data.prepared import PreparedSet
from training.data.store import ResidentArrays, ShapeStore
from training.data.views import LONGEST_EDGE, pieces_of, render_views
from training.inputs.augmentation import damaged
from training.inputs.meshbatch import VIEWS
from training.recipe import DamageRecipe
from training.shapes.catalogue import binary_ply


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> PreparedSet:
    folder = tmp_path_factory.mktemp("shapes")
    for index in range(6):
        mesh = box(1.0, 2.0, 3.0 + index)
        (folder / f"{index}.ply").write_bytes(binary_ply(mesh.vertices, mesh.faces))
    out = folder / "prepared"
    prepare([folder], out, Options(samples=1000), progress=False)
    return PreparedSet(out)


def test_of_a_box_each_image_sees_the_sides_that_face_it():
    mesh = box(1.0, 2.0, 3.0)
    frame = UnitFrame.of(mesh.vertices, mesh.faces)
    vertices, faces, seen = pieces_of(frame.to_unit(mesh.vertices), mesh.faces, seed=3)
    corners = vertices[faces]
    assert np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max() <= LONGEST_EDGE + 1e-4
    areas = triangle_areas(corners)
    assert areas.sum() == pytest.approx(22.0 / frame.scale**2, rel=1e-3)
    outwards = face_normals(vertices, faces)
    outwards *= np.sign(np.einsum("ij,ij->i", outwards, corners.mean(1)))[:, None]
    directions = np.random.default_rng(3).normal(size=(VIEWS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for view, direction in enumerate(directions):
        part = ((seen >> view) & 1).astype(bool)
        along = outwards @ direction
        # A side that is seen edge-on may be lost, as in a scan.
        assert part[along < -0.5].mean() > 0.97
        assert part[along > 0.1].mean() < 0.1


def test_a_set_is_rendered_once_and_read_alike_from_files_and_memory(prepared: PreparedSet):
    with pytest.raises(ValueError, match="training views"):
        ShapeStore(prepared, torch.device("cpu"), 32, pieces=True)
    first = render_views(prepared, progress=False)
    stamp = (prepared.shards[0] / "piece_seen.npy").stat().st_mtime_ns
    again = PreparedSet(prepared.root)
    assert render_views(again, progress=False) == first
    assert (prepared.shards[0] / "piece_seen.npy").stat().st_mtime_ns == stamp
    assert again.views is not None
    assert again.views["pieces"] == first.pieces
    shapes = torch.tensor([4, 1])
    mapped = ShapeStore(again, torch.device("cpu"), 32, pieces=True).meshes(shapes)
    resident = ResidentArrays(again, torch.device("cpu"), 32, None, pieces=True).meshes(shapes)
    assert torch.equal(mapped.corners, resident.corners)
    assert mapped.seen is not None
    assert resident.seen is not None
    assert torch.equal(mapped.seen, resident.seen)


def test_scans_keep_what_is_seen_and_more_images_see_more(prepared: PreparedSet):
    render_views(prepared, progress=False)
    store = ShapeStore(PreparedSet(prepared.root), torch.device("cpu"), 32, pieces=True)
    whole = store.meshes(torch.arange(6))
    total = whole.per_shape(whole.areas)

    def kept(share: float, shares: tuple[float, ...]) -> torch.Tensor:
        recipe = replace(DamageRecipe(), scans=share, scan_shares=shares)
        scanned = damaged(whole, recipe, torch.Generator().manual_seed(1))
        return scanned.per_shape(scanned.areas) / total

    assert torch.allclose(kept(1.0, (1.0, 0.0, 0.0)), torch.tensor(0.5), atol=0.08)
    assert float(kept(1.0, (0.0, 0.0, 1.0)).mean()) > 0.65
    some = kept(0.5, (1.0, 0.0, 0.0))
    assert 0 < int((some < 0.9).sum()) < 6
    with pytest.raises(ValueError, match="training views"):
        damaged(
            ShapeStore(prepared, torch.device("cpu"), 32).meshes(torch.arange(2)),
            DamageRecipe(scans=0.5),
            torch.Generator(),
        )
