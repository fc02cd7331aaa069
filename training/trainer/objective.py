"""The objective of a step: draws the inputs, runs the network, computes the losses in the canonical frame."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from model.network.network import PRSNet
from training.data.store import ShapeStore
from training.inputs.inputs import Pose, draw_inputs, voxels_of
from training.inputs.rotations import rotation_matrices
from training.recipe import Recipe
from training.trainer.distributed import World
from training.trainer.losses import Losses, combine, reflections
from training.trainer.precision import Precision, mixed
from training.trainer.supervision import PlaneLabels, supervised

_VALIDATION_SEED = 20_190_419


@dataclass(slots=True)
class Batch:
    """One batch: its losses, and what was predicted in the fed frame, detached.

    ``planes`` ``(b, p, 4)``, ``quaternions`` ``(b, r, 4)``; ``supervision`` is the supervised loss before its weight,
    which is no part of the losses, 0 without labels.
    """

    losses: Losses
    planes: Tensor
    quaternions: Tensor
    supervision: Tensor


def batch_losses(
    network: nn.Module,
    store: ShapeStore,
    shapes: Tensor,
    recipe: Recipe,
    generator: torch.Generator,
    labels: PlaneLabels | None = None,
    world: World | None = None,
    precision: Precision = "float32",
) -> Batch:
    """Draw inputs for ``shapes`` ``(b,)``, run the network, evaluate the loss in the canonical frame.

    The predicted transforms are rotated back into the canonical frame and act on the samples there; the transformed
    points are looked up in the canonical closest-point grid, so no grid is ever recomputed. Among several processes
    everything random is drawn for the whole batch, and the rest is done for this process's part of it.
    """
    fed, pose = draw_inputs(store.meshes(shapes), recipe.input, recipe.damage, generator)
    samples = store.draw_samples(shapes, recipe.loss.samples, generator)
    if world is not None and world.size > 1:
        own = world.part(len(shapes))
        fed, samples, shapes = fed.part(own), samples[own], shapes[own]
        pose = Pose(pose.rotation[own], pose.center[own], pose.scale[own])
    voxels = voxels_of(fed, recipe.network.resolution).contiguous(memory_format=torch.channels_last_3d)
    with mixed(precision, voxels.device):
        planes, quaternions = network(voxels)
    mirrors, shifts = reflections(planes)
    linear = torch.cat([mirrors, rotation_matrices(quaternions)], dim=1)
    shift = torch.cat([shifts, quaternions.new_zeros((*quaternions.shape[:2], 3))], dim=1)
    linear, shift = pose.to_canonical(linear, shift)
    heads = linear.shape[1]
    # All heads in one product: the columns are (head, coordinate).
    columns = linear.permute(0, 3, 1, 2).flatten(2)
    transformed = torch.baddbmm(shift.flatten(1)[:, None], samples, columns).view(len(shapes), -1, 3)
    closest = store.closest(shapes, transformed.detach())
    distances = (transformed - closest).square().sum(-1)
    if not recipe.loss.squared:
        distances = (distances + 1e-12).sqrt()
    if recipe.loss.mask_occupied:
        distances = distances.masked_fill(store.occupied(transformed.detach(), closest), 0.0)
    distances = distances.unflatten(1, (recipe.loss.samples, heads))
    losses = combine(distances, planes, quaternions, recipe.loss.regularization, recipe.loss.best_head)
    supervision_loss = (
        planes.new_zeros(()) if labels is None else supervised(labels, shapes, planes, pose, recipe.supervision)
    )
    return Batch(losses, planes.detach(), quaternions.detach(), supervision_loss)


@torch.no_grad()
def validate(
    network: PRSNet, store: ShapeStore, shapes: Tensor, recipe: Recipe, labels: PlaneLabels | None = None
) -> dict[str, float]:
    """Losses on held-out shapes, always the same inputs; errors come from the training grid and are biased up."""
    network.eval()
    generator = torch.Generator(store.device).manual_seed(_VALIDATION_SEED)
    total, supervision_loss, planes = 0.0, 0.0, []
    for chunk in shapes.split(64):
        batch = batch_losses(network, store, chunk, recipe, generator, labels)
        total += float(batch.losses.total) * len(chunk)
        supervision_loss += float(batch.supervision) * len(chunk)
        planes.append(batch.losses.plane_errors)
    network.train()
    errors = torch.cat(planes)
    best = errors.amin(1)
    measured = {
        "validation_loss": total / len(shapes),
        "validation_best_plane": float(best.mean()),
        "validation_plane": float(errors.mean()),
        "validation_share": float((best <= 4e-4).float().mean()),
    }
    return measured if labels is None else {**measured, "validation_supervision": supervision_loss / len(shapes)}
