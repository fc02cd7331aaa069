"""Damage drawn on the fly does what it is called, to as many shapes as asked, and always the same for a seed."""

from dataclasses import replace
from typing import Any

import pytest
import torch

from training.inputs.augmentation import damaged
from training.inputs.inputs import voxels_of
from training.inputs.meshbatch import MeshBatch, unit_frames
from training.recipe import DamageRecipe

SHAPES = 40


def batch() -> MeshBatch:
    """Wavy sheets of 800 triangles, 0.6 wide and each 0.25 deep."""
    steps = torch.linspace(-0.3, 0.3, 21)
    x, y = torch.meshgrid(steps, steps, indexing="ij")
    points = torch.stack([x, y, 0.12 * torch.sin(9.0 * x) * torch.cos(7.0 * y)], dim=-1)
    first, second = points[:-1, :-1], points[1:, :-1]
    third, fourth = points[1:, 1:], points[:-1, 1:]
    corners = torch.stack([torch.stack([first, second, third], 2), torch.stack([first, third, fourth], 2)]).view(
        -1, 3, 3
    )
    shape = torch.arange(SHAPES).repeat_interleave(len(corners))
    return MeshBatch(corners.repeat(SHAPES, 1, 1), shape, SHAPES)


def draw(**damage: Any) -> MeshBatch:
    return damaged(batch(), replace(DamageRecipe(), **damage), torch.Generator().manual_seed(0))


@pytest.mark.parametrize("kind", ["share", "cuts", "noise", "clusters", "doubled", "spikes", "sparse", "outliers"])
def test_a_share_of_the_shapes_is_changed_and_the_rest_left_alone(kind: str):
    whole = batch()
    # Of the cuts about half would take more than half of the surface; those are not made.
    for share, least, most in ((1.0, SHAPES // 3, SHAPES), (0.5, 4, SHAPES - 8)):
        changed = draw(**{kind: share})
        assert bool((changed.shape.diff() >= 0).all())
        differ = 0
        for index in range(SHAPES):
            now, before = changed.corners[changed.shape == index], whole.corners[whole.shape == index]
            differ += now.shape != before.shape or not torch.equal(now, before)
        assert least <= differ <= most, kind
    assert torch.equal(draw(**{kind: 0.5}).corners, draw(**{kind: 0.5}).corners)
    assert torch.equal(draw().corners, whole.corners)


def test_clusters_merge_neighbouring_vertices():
    whole, merged = batch(), draw(clusters=1.0, cluster_size=0.1)
    assert float((merged.corners - whole.corners).norm(dim=-1).max()) <= 0.1 * 3**0.5 / 2 + 1e-6
    fewer = 0
    for index in range(SHAPES):
        here = merged.shape == index
        before = torch.unique((whole.corners[here].reshape(-1, 3) * 1e5).round(), dim=0)
        fewer += len(torch.unique((merged.corners[here].reshape(-1, 3) * 1e5).round(), dim=0)) < 0.7 * len(before)
    assert fewer > SHAPES / 3
    # What stood at one place still does: no gaps.
    places: dict[tuple[float, ...], torch.Tensor] = {}
    for old, new in zip(whole.corners[:800].reshape(-1, 3).tolist(), merged.corners[:800].reshape(-1, 3), strict=True):
        same = places.setdefault(tuple(round(value, 5) for value in old), new)
        torch.testing.assert_close(same, new, atol=1e-5, rtol=0.0)


def test_what_is_thinner_than_a_cell_does_not_vanish():
    ribbon = MeshBatch(torch.tensor([[[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.5, 0.001, 0.0]]]), torch.zeros(1).long(), 1)
    for seed in range(20):
        generator = torch.Generator().manual_seed(seed)
        assert float(damaged(ribbon, DamageRecipe(clusters=1.0, cluster_size=0.2), generator).areas.sum()) > 1e-4


def test_doubled_faces_move_the_frame_and_not_a_voxel():
    whole, doubled = batch(), draw(doubled=1.0)
    assert torch.equal(voxels_of(whole, 16), voxels_of(doubled, 16))
    areas, more = (meshes.per_shape(meshes.areas) for meshes in (whole, doubled))
    assert bool((more <= 2.0 * areas + 1e-6).all())
    moved = (unit_frames(doubled)[0] - unit_frames(whole)[0]).norm(dim=1)
    assert float(moved.median()) > 0.02


def test_spikes_are_long_and_weigh_nothing():
    whole, spiked = batch(), draw(spikes=1.0, spike_length=0.4)
    assert bool((spiked.counts == whole.counts + 1).all())
    extra = spiked.per_shape(spiked.areas) - whole.per_shape(whole.areas)
    assert float(extra.max()) < 0.01 * float(whole.per_shape(whole.areas)[0])
    last = spiked.counts.cumsum(0) - 1  # a stable sort: the needle comes last
    lengths = (spiked.corners[last, 2] - spiked.corners[last, 0]).norm(dim=1)
    assert 0.3 < float(lengths.max()) <= 0.4
    assert bool(torch.isin(spiked.corners[last, 0].sum(1), whole.middles.sum(1)).all())


def test_no_more_than_half_of_a_surface_goes():
    for kind in ("share", "cuts"):
        left = draw(**{kind: 1.0, "radius": (0.3, 0.6)})
        assert float((left.per_shape(left.areas) / batch().per_shape(batch().areas)).min()) >= 0.5 - 1e-5
