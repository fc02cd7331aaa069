"""The losses say what the paper's equations say."""

import numpy as np
import torch

from model.geometry.transforms import reflect, rotation_matrix
from training.inputs.rotations import rotation_matrices
from training.trainer.losses import combine, reflections, regularization


def unit_planes(count: int, seed: int) -> np.ndarray:
    planes = np.random.default_rng(seed).normal(size=(count, 4))
    planes[:, :3] /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    return planes


def test_reflections_are_equation_1():
    planes = unit_planes(3, 0)
    points = np.random.default_rng(1).normal(size=(20, 3))
    linear, shift = reflections(torch.from_numpy(planes)[None])
    for head, plane in enumerate(planes):
        ours = points @ linear[0, head].numpy().T + shift[0, head].numpy()
        np.testing.assert_allclose(ours, reflect(points, plane), atol=1e-12)


def test_rotations_are_equation_2():
    rng = np.random.default_rng(2)
    axis, angle = rng.normal(size=3), 1.1
    axis /= np.linalg.norm(axis)
    quaternion = torch.tensor([np.cos(angle / 2), *(np.sin(angle / 2) * axis)])
    np.testing.assert_allclose(rotation_matrices(quaternion).numpy(), rotation_matrix(axis, angle), atol=1e-12)


def test_regularization_is_zero_for_perpendicular_half_turns_and_grows_with_overlap():
    planes = torch.eye(3, 4)[None]
    turns = torch.cat([torch.zeros(3, 1), torch.eye(3)], 1)[None]
    assert regularization(planes, turns) == 0.0
    doubled = planes[:, [0, 0, 2]]
    torch.testing.assert_close(regularization(doubled, turns), torch.tensor([2.0]))
    # Three identities: B = -I, so the loss charges 3 for rotations that do nothing.
    identity = torch.tensor([1.0, 0, 0, 0]).expand(1, 3, 4)
    torch.testing.assert_close(regularization(planes, identity), torch.tensor([3.0]))


def test_total_is_the_sum_over_a_thousand_samples_and_the_heads_averaged_over_the_batch():
    """Of fewer samples each counts for more, so that the paper's weights keep their meaning."""
    generator = torch.Generator().manual_seed(0)
    distances = torch.rand((5, 7, 6), generator=generator)
    planes = torch.nn.functional.normalize(torch.randn((5, 3, 4), generator=generator), dim=-1)
    turns = torch.nn.functional.normalize(torch.randn((5, 3, 4), generator=generator), dim=-1)
    losses = combine(distances, planes, turns, weight=25.0, best_head=0.0)
    share = 1000 / 7
    expected = sum(
        share * float(distances[shape, :, head].sum()) for shape in range(5) for head in range(6)
    ) / 5 + 25.0 * float(regularization(planes, turns).mean())
    np.testing.assert_allclose(float(losses.total), expected, rtol=1e-5)
    with_best = combine(distances, planes, turns, weight=25.0, best_head=2.0)
    best = share * float(distances[..., :3].sum(1).amin(1).mean())
    np.testing.assert_allclose(float(with_best.total - losses.total), 2.0 * 3.0 * best, rtol=1e-4)
    torch.testing.assert_close(losses.plane_errors, distances[..., :3].mean(1))
