"""The input pipeline: damage, frame, rotation and voxels, drawn on the fly for every sample."""

from dataclasses import dataclass

import torch
from torch import Tensor

from training.inputs.augmentation import damaged
from training.inputs.meshbatch import MeshBatch, covariances, unit_frames
from training.inputs.rotations import rotation_vectors, uniform_rotations
from training.inputs.voxelize import voxelize_batch
from training.recipe import DamageRecipe, InputRecipe


@dataclass(slots=True)
class Pose:
    """The frame the network is fed with: ``fed = rotation (canonical - center) / scale``.

    Canonical is the unit frame of the prepared shape.
    ``rotation`` ``(b, 3, 3)`` orthogonal, ``center`` ``(b, 3)``, ``scale`` ``(b,)``.
    """

    rotation: Tensor
    center: Tensor
    scale: Tensor

    def to_canonical(self, linear: Tensor, shift: Tensor) -> tuple[Tensor, Tensor]:
        """Affine maps ``(b, h, 3, 3)`` (orthogonal), ``(b, h, 3)`` of the fed frame as maps of the canonical frame."""
        rotation = self.rotation[:, None]
        linear = rotation.mT @ linear @ rotation
        moved = (shift[:, :, None] @ rotation)[:, :, 0] * self.scale[:, None, None]
        center = self.center[:, None, :, None]
        return linear, moved + self.center[:, None] - (linear @ center)[..., 0]


def draw_inputs(
    meshes: MeshBatch, recipe: InputRecipe, damage: DamageRecipe, generator: torch.Generator
) -> tuple[MeshBatch, Pose]:
    """Damage the meshes, draw each one's frame: the meshes as fed, and where that frame lies."""
    meshes = damaged(meshes, damage, generator)
    center, scale = unit_frames(meshes)
    if recipe.frame == "unit":
        rotation = uniform_rotations(meshes.size, generator, meshes.corners.device)
    else:
        rotation = _inertia_rotations(meshes, center, recipe, generator)
    return meshes.moved(rotation, center, scale), Pose(rotation, center, scale)


def voxels_of(meshes: MeshBatch, resolution: int) -> Tensor:
    """Network input ``(b, 1, R, R, R)`` float32: the exact voxels of service, whatever the device."""
    if meshes.corners.device.type != "cpu":
        return voxelize_batch(meshes, resolution).unsqueeze(1).float()
    try:
        from model.geometry.voxels import voxelize
    except ImportError:  # a bare machine with torch and numpy alone
        return voxelize_batch(meshes, resolution).unsqueeze(1).float()
    counts = meshes.counts.tolist()
    grids: list[Tensor] = []
    for corners in meshes.corners.double().split(counts):
        faces = torch.arange(3 * len(corners), dtype=torch.int32).view(-1, 3)
        grids.append(torch.from_numpy(voxelize(corners.reshape(-1, 3).numpy(), faces.numpy(), resolution)))
    return torch.stack(grids).unsqueeze(1).float()


def _inertia_rotations(meshes: MeshBatch, center: Tensor, recipe: InputRecipe, generator: torch.Generator) -> Tensor:
    device = center.device
    # The eigenvectors of 3 x 3 matrices: a GPU solves thousands of tiny problems slower than the CPU does.
    values, vectors = torch.linalg.eigh(covariances(meshes, center).double().cpu())
    values, vectors = values.flip(-1).to(device).float(), vectors.flip(-1).to(device).float()
    frame = vectors.mT
    signs = torch.randint(0, 2, (meshes.size, 3), generator=generator, device=device) * 2.0 - 1.0
    frame = signs[:, :, None] * frame
    frame = torch.linalg.det(frame)[:, None, None].sign() * frame
    choice = torch.multinomial(
        torch.tensor(recipe.jitter_shares, device=device), meshes.size, replacement=True, generator=generator
    )
    deviation = torch.tensor(recipe.jitters, device=device)[choice]
    jitter = torch.randn((meshes.size, 3), generator=generator, device=device) * deviation[:, None]
    # A rotation about eigenvector k mixes the two others: how far depends on how close their eigenvalues lie.
    pairs = torch.tensor([[1, 2], [0, 2], [0, 1]], device=device)
    gaps = (values[:, pairs[:, 0]] - values[:, pairs[:, 1]]) / values[:, :1].clamp_min(1e-12)
    spread = recipe.tie / gaps.clamp_min(recipe.tie / torch.pi)
    # Below a tenth of a radian the eigenvectors are well defined and the jitter above says enough.
    spread = torch.where(spread > 0.1, spread, 0.0)
    loose = torch.randn((meshes.size, 3), generator=generator, device=device) * spread
    return rotation_vectors(jitter) @ rotation_vectors(loose) @ frame
