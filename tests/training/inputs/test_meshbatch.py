"""Training's torch geometry against the geometry of the service."""

import numpy as np
import pytest
import torch

from model.geometry.frames import UnitFrame, inertia_frame
from model.geometry.surface import SurfaceIndex
from model.geometry.voxels import voxelize
from model.meshes.mesh import Mesh
from tests.shapes import as_mesh, box, known, pose
from training.data.closest_grid import flood_closest, voxel_centres
from training.inputs.inputs import draw_inputs, voxels_of
from training.inputs.meshbatch import MeshBatch, covariances, gather, sample_surfaces, unit_frames
from training.inputs.rotations import rotation_matrices, uniform_rotations
from training.inputs.voxelize import voxelize_batch
from training.recipe import DamageRecipe, InputRecipe
from training.trainer.losses import reflections

FAMILIES = ("chair", "prism", "none", "torus")


def meshes() -> list[Mesh]:
    return [as_mesh(known(family)) for family in FAMILIES] + [box()]


def batch_of(shapes: list[Mesh]) -> MeshBatch:
    counts = torch.tensor([[0, 0], *[[len(m.vertices), len(m.faces)] for m in shapes]]).cumsum(0)
    vertices = torch.from_numpy(np.concatenate([m.vertices for m in shapes])).float()
    faces = torch.from_numpy(np.concatenate([m.faces for m in shapes]))
    return gather(vertices, faces, counts[:, 0], counts[:, 1], torch.arange(len(shapes)))


def unit(mesh: Mesh) -> Mesh:
    return Mesh.checked(UnitFrame.of(mesh.vertices, mesh.faces).to_unit(mesh.vertices), mesh.faces)


def test_gather_takes_shapes_in_any_order():
    shapes = meshes()
    counts = torch.tensor([[0, 0], *[[len(m.vertices), len(m.faces)] for m in shapes]]).cumsum(0)
    vertices = torch.from_numpy(np.concatenate([m.vertices for m in shapes]))
    faces = torch.from_numpy(np.concatenate([m.faces for m in shapes]))
    order = torch.tensor([3, 0, 3])
    batch = gather(vertices, faces, counts[:, 0], counts[:, 1], order)
    for slot, index in enumerate(order.tolist()):
        expected = shapes[index].vertices[shapes[index].faces]
        np.testing.assert_array_equal(batch.corners[batch.shape == slot].numpy(), expected)


def test_frames_are_the_services():
    shapes = meshes()
    batch = batch_of(shapes)
    center, scale = unit_frames(batch)
    for index, mesh in enumerate(shapes):
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
        np.testing.assert_allclose(center[index], frame.center, atol=1e-5 * frame.scale)
        assert float(scale[index]) == pytest.approx(frame.scale, rel=1e-5)
    centred = batch.moved(torch.eye(3).expand(len(shapes), 3, 3), center, scale)
    moments = covariances(centred, torch.zeros(len(shapes), 3))
    for index, mesh in enumerate(shapes):
        rotation, values = inertia_frame(unit(mesh).vertices, mesh.faces)
        np.testing.assert_allclose(rotation @ moments[index].double().numpy() @ rotation.T, np.diag(values), atol=1e-6)


@pytest.mark.parametrize("resolution", [8, 32])
def test_voxels_are_the_services_to_the_last_one(resolution: int):
    shapes = [unit(mesh) for mesh in meshes()]
    for seed in range(3):
        rotation, _, _ = pose(seed)
        turned = [Mesh.checked(mesh.vertices @ rotation.T, mesh.faces) for mesh in shapes]
        batch = batch_of(turned)
        found = voxelize_batch(batch, resolution)
        for index, mesh in enumerate(turned):
            exact = voxelize(mesh.vertices.astype(np.float32).astype(np.float64), mesh.faces, resolution)
            extra = found[index].numpy() & ~exact
            assert not (exact & ~found[index].numpy()).any()
            # Single precision may add a voxel that the surface misses by a millionth of its edge.
            assert extra.sum() <= 0.002 * exact.sum()
        np.testing.assert_array_equal(voxels_of(batch, resolution)[:, 0].bool() & ~found, np.zeros_like(found))


def test_samples_lie_on_their_triangles():
    shapes = meshes()
    points, face = sample_surfaces(batch_of(shapes), 500, torch.Generator().manual_seed(0))
    for index, mesh in enumerate(shapes):
        distances = SurfaceIndex(mesh.vertices, mesh.faces).squared_distances(points[index].double().numpy())
        assert distances.max() < (3e-6 * np.abs(mesh.vertices).max()) ** 2  # single precision
    assert (face[1:].amin(1) > face[:-1].amax(1)).all()


def test_flooded_grid_is_nearly_the_nearest_sample():
    points, _ = sample_surfaces(batch_of([unit(mesh) for mesh in meshes()]), 6000, torch.Generator().manual_seed(0))
    found = flood_closest(points, 16)
    centres = voxel_centres(16, points.device)
    exact = torch.cdist(centres.expand(len(points), -1, -1), points).amin(2)
    reached = (found - centres).norm(dim=-1)
    assert (reached >= exact - 1e-5).all()
    # One sample a voxel is passed on: the answer may be off by a part of its edge, never by more than its diagonal.
    assert (reached - exact).mean() < 0.1 / 16
    assert (reached - exact).max() < 3**0.5 / 16


def test_transforms_come_back_from_the_fed_frame():
    """A plane predicted in the fed frame, taken back, is the reflection of the canonical frame."""
    generator = torch.Generator().manual_seed(0)
    shapes = [unit(mesh) for mesh in meshes()]
    batch = batch_of(shapes)
    damage = DamageRecipe(share=1.0, radius=(0.2, 0.3))
    fed, pose_ = draw_inputs(batch, InputRecipe(frame="inertia"), damage, generator)
    center, scale = unit_frames(fed)
    torch.testing.assert_close(center, torch.zeros_like(center), atol=1e-5, rtol=0)
    torch.testing.assert_close(scale, torch.ones_like(scale), atol=1e-5, rtol=0)
    points = torch.randn((len(shapes), 40, 3), generator=generator)

    def to_fed(x: torch.Tensor) -> torch.Tensor:
        return (x - pose_.center[:, None]) @ pose_.rotation.mT / pose_.scale[:, None, None]

    planes = torch.randn((len(shapes), 2, 4), generator=generator)
    planes = planes / planes[..., :3].norm(dim=-1, keepdim=True)
    turns = torch.nn.functional.normalize(torch.randn((len(shapes), 2, 4), generator=generator), dim=-1)
    mirrors, shifts = reflections(planes)
    linear = torch.cat([mirrors, rotation_matrices(turns)], 1)
    shift = torch.cat([shifts, torch.zeros(len(shapes), 2, 3)], 1)
    canonical_linear, canonical_shift = pose_.to_canonical(linear, shift)
    for head in range(4):
        there = to_fed(points) @ linear[:, head].mT + shift[:, None, head]
        back = to_fed(points @ canonical_linear[:, head].mT + canonical_shift[:, None, head])
        torch.testing.assert_close(back, there, atol=1e-4, rtol=1e-4)


def test_inertia_input_is_aligned_up_to_the_jitter():
    batch = batch_of([unit(box(1.0, 2.0, 3.0))] * 64)
    recipe = InputRecipe(frame="inertia", jitters=(0.05,), jitter_shares=(1.0,), tie=0.02)
    _, pose_ = draw_inputs(batch, recipe, DamageRecipe(), torch.Generator().manual_seed(1))
    # Rows of the pose are jittered z, y, x (descending variance), signs at random.
    cosines = (pose_.rotation @ torch.eye(3).flip(0)).diagonal(dim1=1, dim2=2)
    angles = torch.rad2deg(torch.arccos(cosines.abs().clamp(max=1)))
    assert 1.0 < angles.mean() < 6.0
    assert (cosines > 0).any()
    assert (cosines < 0).any()
    torch.testing.assert_close(torch.linalg.det(pose_.rotation), torch.ones(64))


def test_tied_eigenvalues_are_drawn_wide():
    recipe = InputRecipe(frame="inertia", jitters=(0.001,), jitter_shares=(1.0,), tie=0.02)
    batch = batch_of([unit(box(1.0, 1.0, 3.0))] * 256)
    _, pose_ = draw_inputs(batch, recipe, DamageRecipe(), torch.Generator().manual_seed(1))
    along = pose_.rotation[:, 0, 2].abs()
    assert along.min() > 0.999  # the long axis is well defined
    turned = torch.rad2deg(torch.atan2(pose_.rotation[:, 1, 1], pose_.rotation[:, 1, 0]))
    counts = torch.histc(turned % 90, 6, 0, 90)
    assert counts.min() > 20  # the square cross-section comes in every orientation


def test_holes_remove_a_part_but_never_the_most():
    shapes = [unit(as_mesh(known("torus")))] * 32
    batch = batch_of(shapes)
    fed, _ = draw_inputs(
        batch, InputRecipe(), DamageRecipe(share=0.5, radius=(0.2, 0.4)), torch.Generator().manual_seed(0)
    )
    kept = torch.bincount(fed.shape, minlength=32) / torch.bincount(batch.shape, minlength=32)
    assert 6 < (kept < 1).sum() < 26
    assert kept.min() > 0.4


def test_rotations_are_uniform_on_so3():
    matrices = uniform_rotations(20_000, torch.Generator().manual_seed(0), torch.device("cpu"))
    torch.testing.assert_close(matrices @ matrices.mT, torch.eye(3).expand(20_000, 3, 3), atol=1e-5, rtol=0)
    torch.testing.assert_close(torch.linalg.det(matrices), torch.ones(20_000), atol=1e-5, rtol=0)
    assert matrices.mean(0).abs().max() < 0.02  # every column is uniform on the sphere
    assert (matrices.square().mean(0) - 1 / 3).abs().max() < 0.01
    trace = matrices.diagonal(dim1=1, dim2=2).sum(1)
    assert abs(float(trace.mean())) < 0.03
