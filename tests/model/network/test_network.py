"""The network is the paper's, and its sparse first block changes nothing but the time."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
import torch

from model.formats import read_mesh
from model.geometry.frames import UnitFrame, inertia_frame
from model.geometry.transforms import axis_angle
from model.geometry.voxels import voxelize
from model.network.architecture import NORMALISATION_EPSILON, Architecture
from model.network.checkpoint import Checkpoint, InputSpec, load_checkpoint, weights_of
from model.network.inference import CpuNetwork
from model.network.network import PRSNet
from model.network.sparse_block import convolve_and_pool
from tests.shapes import box


def surface_voxels(resolution: int, count: int = 3) -> torch.Tensor:
    grids = []
    for size in range(count):
        mesh = box(0.3 + 0.2 * size, 0.6, 0.9)
        grids.append(voxelize(mesh.vertices, mesh.faces, resolution))
    return torch.from_numpy(np.stack(grids)).unsqueeze(1).float()


def compiled(network: PRSNet) -> CpuNetwork:
    return CpuNetwork(network.architecture, weights_of(network))


def test_parameter_count_is_the_papers():
    assert sum(p.numel() for p in PRSNet().parameters()) == 89_728


@pytest.mark.parametrize("resolution", [2, 8, 16, 32, 64])
def test_any_power_of_two_gives_log2_blocks(resolution: int):
    network = PRSNet(Architecture(resolution=resolution)).eval()
    blocks = sum(isinstance(module, torch.nn.Conv3d) for module in network.features)
    assert 2**blocks == resolution
    planes, quaternions = network(surface_voxels(resolution))
    assert planes.shape == quaternions.shape == (3, 3, 4)


@pytest.mark.parametrize("resolution", [0, 1, 24, 33])
def test_other_resolutions_are_refused(resolution: int):
    with pytest.raises(ValueError, match="power of two"):
        Architecture(resolution=resolution)


def test_starts_at_perpendicular_planes_and_half_turns():
    torch.manual_seed(0)
    planes, quaternions = PRSNet().eval()(surface_voxels(32))
    assert torch.equal(planes, torch.eye(3, 4).expand(3, 3, 4))
    directions, angles = axis_angle(quaternions.detach().double().numpy())
    assert (np.abs(np.diagonal(directions, axis1=1, axis2=2)) > 0.9).all()
    assert (angles > 0.9 * np.pi).all()


def test_outputs_are_normalised():
    torch.manual_seed(1)
    network = PRSNet(Architecture(width=2, batch_norm=True)).eval()
    for head in network.plane_heads:
        torch.nn.init.normal_(head[-1].weight)
    planes, quaternions = network(surface_voxels(32))
    torch.testing.assert_close(planes[..., :3].norm(dim=-1), torch.ones(3, 3))
    torch.testing.assert_close(quaternions.norm(dim=-1), torch.ones(3, 3))


@pytest.mark.parametrize("filling", [0.0, 0.001, 0.03, 1.0])
@pytest.mark.parametrize("resolution", [2, 8, 32])
def test_sparse_block_equals_convolution_and_pooling(filling: float, resolution: int):
    generator = torch.Generator().manual_seed(int(1000 * filling) + resolution)
    voxels = (torch.rand((3, 1, *[resolution] * 3), generator=generator) < filling).float()
    sparse, dense = torch.nn.Conv3d(1, 5, 3, padding=1), torch.nn.Conv3d(1, 5, 3, padding=1)
    dense.load_state_dict(sparse.state_dict())
    ours = convolve_and_pool(voxels, sparse.weight, sparse.bias)
    theirs = torch.nn.functional.max_pool3d(dense(voxels), 2)
    torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=1e-5)
    if 0.0 < filling < 1.0:  # elsewhere many positions tie for the maximum, and share the gradient differently
        weights = torch.rand(theirs.shape, generator=generator)
        (ours * weights).sum().backward()
        (theirs * weights).sum().backward()
        torch.testing.assert_close(sparse.bias.grad, dense.bias.grad, atol=1e-3, rtol=1e-4)


def test_axis_angle_returns_what_built_the_quaternion():
    rng = np.random.default_rng(2)
    axes = rng.normal(size=(50, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angles = rng.uniform(0.01, np.pi - 0.01, 50)
    quaternions = np.hstack([np.cos(angles / 2)[:, None], np.sin(angles / 2)[:, None] * axes])
    for sign in (1.0, -1.0):
        found_axes, found_angles = axis_angle(sign * quaternions)
        np.testing.assert_allclose(found_angles, angles, atol=1e-12)
        np.testing.assert_allclose(found_axes, axes, atol=1e-12)


def test_axis_angle_of_the_identity_is_no_turn():
    axis, angle = axis_angle(np.array([1.0, 0.0, 0.0, 0.0]))
    assert angle == 0.0
    assert np.linalg.norm(axis) == 1.0


@pytest.mark.parametrize("batch_norm", [False, True])
@pytest.mark.parametrize("resolution", [2, 4, 16])
def test_the_compiled_network_gives_the_same_planes(batch_norm: bool, resolution: int):
    """Random surfaces, empty and full ones and voxels at the border of the grid among them."""
    torch.manual_seed(0)
    blocks = resolution.bit_length() - 1
    network = PRSNet(
        Architecture(resolution=resolution, batch_norm=batch_norm, channels=(6, 8, 10, 12)[:blocks], rotations=2)
    )
    for parameter in network.parameters():
        parameter.data.add_(0.1 * torch.randn(parameter.shape))
    for layer in network.features:
        if isinstance(layer, torch.nn.BatchNorm3d):
            layer.weight.data.uniform_(-1.0, 1.0)  # a negative scale turns the order around that pooling relies on
            layer.running_mean.uniform_(-0.1, 0.1)
            layer.running_var.uniform_(0.5, 2.0)
    network.eval()
    flips = np.array(list(product((False, True), repeat=3)))
    for filling in (0.0, 0.02, 0.3, 1.0):
        occupied = torch.rand([resolution] * 3) < filling
        if filling == 0.3:
            occupied[0], occupied[:, -1] = True, True
        frames = [occupied.flip([axis for axis in range(3) if flip[axis]]) for flip in flips]
        with torch.inference_mode():
            planes, quaternions = network(torch.stack(frames)[:, None].float())
        ours = compiled(network)((occupied.numpy(), flips))
        np.testing.assert_allclose(ours[0], planes, atol=1e-6, rtol=1e-5)
        np.testing.assert_allclose(ours[1], quaternions, atol=1e-6, rtol=1e-5)


def test_a_network_with_another_layer_gives_the_same_planes_too():
    torch.manual_seed(4)
    network = PRSNet(Architecture(resolution=8, channels=(4, 6, 8)))
    for parameter in network.parameters():
        parameter.data.add_(0.1 * torch.randn(parameter.shape))
    network.features.insert(3, torch.nn.GroupNorm(2, 4))  # behind the first block's activation
    network.eval()
    occupied = (torch.rand([8] * 3) < 0.2).numpy()
    flips = np.array(list(product((False, True), repeat=3)))
    frames = np.stack([np.flip(occupied, np.flatnonzero(flip)) for flip in flips])
    with torch.inference_mode():
        planes, quaternions = network(torch.from_numpy(frames).float()[:, None])
    ours = Checkpoint.of(network, InputSpec(), {}).compiled((occupied, flips[:3]), (occupied, flips[3:]))
    assert planes.std(0).max() > 1e-3
    np.testing.assert_allclose(ours[0], planes, atol=1e-6, rtol=1e-5)
    np.testing.assert_allclose(ours[1], quaternions, atol=1e-6, rtol=1e-5)


@pytest.mark.parametrize("weights", ["default", "paper"])
def test_the_shipped_weights_give_the_same_planes_without_torch(weights: str):
    checkpoint = load_checkpoint(weights)
    flips = np.array(list(product((False, True), repeat=3)))
    for path in sorted((Path(__file__).parents[2] / "data").glob("*.[!m]*")):
        mesh = read_mesh(path.read_bytes(), path.name)
        vertices = UnitFrame.of(mesh.vertices, mesh.faces).to_unit(mesh.vertices)
        grid = voxelize(np.ascontiguousarray(vertices @ inertia_frame(vertices, mesh.faces)[0].T), mesh.faces)
        frames = np.stack([np.flip(grid, np.flatnonzero(flip)) for flip in flips])
        with torch.inference_mode():
            expected = checkpoint.network(torch.from_numpy(frames).float()[:, None])
        for ours, theirs in zip(checkpoint.compiled((grid, flips)), expected, strict=True):
            np.testing.assert_allclose(ours, theirs, atol=2e-6, rtol=1e-5)


@pytest.mark.parametrize("batch_norm", [False, True])
def test_the_weights_are_named_and_shaped_as_said_without_torch(batch_norm: bool):
    architecture = Architecture(resolution=16, batch_norm=batch_norm, channels=(3, 5, 8, 9), planes=2, rotations=1)
    network = PRSNet(architecture)
    assert {name: value.shape for name, value in weights_of(network).items()} == architecture.weight_shapes()
    kinds = [torch.nn.Conv3d, torch.nn.MaxPool3d, *[torch.nn.BatchNorm3d] * batch_norm, torch.nn.LeakyReLU]
    assert [[type(layer) for layer in block] for block in network.blocks()] == [kinds] * 4
    assert all(
        layer.eps == NORMALISATION_EPSILON for layer in network.features if isinstance(layer, torch.nn.BatchNorm3d)
    )


def test_a_mirrored_frame_of_a_symmetric_shape_gets_the_same_answer_to_the_last_bit():
    """Where the shape does not change the answer does not: the mean over sign frames is exact."""
    torch.manual_seed(2)
    answer = compiled(PRSNet(Architecture(resolution=16, batch_norm=True, channels=(6, 8, 10, 12))).eval())
    flips = np.array(list(product((False, True), repeat=3)))
    half = (torch.rand([16] * 3) < 0.1).numpy()
    for axis in range(3):
        grid = half | np.flip(half, axis)
        planes, quaternions = answer((grid, flips))
        other = [int(np.flatnonzero((flips == flip ^ (np.arange(3) == axis)).all(1))[0]) for flip in flips]
        assert np.array_equal(planes, planes[other])
        assert np.array_equal(quaternions, quaternions[other])


def test_views_of_one_batch_do_not_touch_each_other():
    torch.manual_seed(1)
    network = PRSNet(Architecture(resolution=8, batch_norm=True, channels=(4, 6, 8))).eval()
    answer = compiled(network)
    flips = np.array(list(product((False, True), repeat=3)))
    grids = [(torch.rand([8] * 3) < filling).numpy() for filling in (0.1, 0.4)]
    views = [(grids[0], flips), (grids[1], flips[:1]), (grids[0], flips[2:4])]
    together = answer(*views)
    alone = [answer(view) for view in views]
    for row, outputs in enumerate(together):
        assert np.array_equal(outputs, np.concatenate([outputs[row] for outputs in alone]))
