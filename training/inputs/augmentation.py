"""Augmentation: the damage that real uploads have, applied to shapes before the network sees them.

One-sided scans, holes, cuts, noise, decimation, doubled faces, thin parts: plain torch on whole batches, drawn on the
fly. The loss is computed on the undamaged shape (paper, section 6.6).
"""

import torch
from torch import Tensor

from training.inputs.meshbatch import VIEWS, MeshBatch
from training.recipe import DamageRecipe

_LEAST_SEEN = 0.1
"""A thin plate seen from its edge shows nothing; such a view is left out."""

_MOST_SPARSE = 0.95
_SPECK = 1e-3
_HASH = ((127.1, 269.5, 419.2), (311.7, 183.3, 371.9), (74.7, 246.1, 151.7))


def damaged(meshes: MeshBatch, damage: DamageRecipe, generator: torch.Generator) -> MeshBatch:
    """Some of the shapes with something done to them, as the recipe says."""
    if damage.scans > 0:
        meshes = _with_scans(meshes, damage, generator)
    if damage.sparse > 0:
        meshes = _with_sparse(meshes, damage, generator)
    if damage.share > 0:
        meshes = _with_holes(meshes, damage, generator)
    if damage.cuts > 0:
        meshes = _with_cuts(meshes, damage, generator)
    if damage.noise > 0:
        meshes = _with_noise(meshes, damage, generator)
    if damage.clusters > 0:
        meshes = _with_clusters(meshes, damage, generator)
    if damage.doubled > 0:
        meshes = _with_doubled(meshes, damage, generator)
    if damage.spikes > 0:
        meshes = _with_spikes(meshes, damage, generator)
    if damage.outliers > 0:
        meshes = _with_outliers(meshes, damage, generator)
    return meshes


def _with_scans(meshes: MeshBatch, damage: DamageRecipe, generator: torch.Generator) -> MeshBatch:
    """Keep what some of the depth images see, for ``scans`` of the shapes."""
    if meshes.seen is None:
        raise ValueError("damage.scans needs a set that `training views` has rendered")
    device = meshes.corners.device
    draws = torch.rand((meshes.size, VIEWS + 1), generator=generator, device=device)
    shares = torch.tensor(damage.scan_shares, device=device)
    images = 1 + torch.multinomial(shares, meshes.size, replacement=True, generator=generator)
    # The views of a shape in random order; the first so many are taken, as bits.
    bits = (1 << draws[:, 1:].argsort(1)) * (torch.arange(VIEWS, device=device) < images[:, None])
    chosen = draws[:, 0] < damage.scans
    hidden = (meshes.seen & bits.sum(1).int()[meshes.shape]) == 0
    return _without(meshes, hidden & chosen[meshes.shape], _LEAST_SEEN)


def _with_sparse(meshes: MeshBatch, damage: DamageRecipe, generator: torch.Generator) -> MeshBatch:
    """Of ``sparse`` of the shapes more and more triangles are missing along a random direction."""
    device = meshes.corners.device
    draws = torch.rand((meshes.size, 2), generator=generator, device=device)
    directions = torch.nn.functional.normalize(torch.randn((meshes.size, 3), generator=generator, device=device), dim=1)
    # Shapes lie in a ball of diameter 1.
    along = (meshes.middles * directions[meshes.shape]).sum(1) + 0.5
    loss = _MOST_SPARSE * draws[:, 0] * (draws[:, 1] < damage.sparse)
    dropped = torch.rand(len(along), generator=generator, device=device) < loss[meshes.shape] * along
    return _without(meshes, dropped, damage.least)


def _with_outliers(meshes: MeshBatch, damage: DamageRecipe, generator: torch.Generator) -> MeshBatch:
    """Up to ten specks about ``outliers`` of the shapes: points that a scanner saw where nothing is."""
    device = meshes.corners.device
    draws = torch.rand((meshes.size, 2), generator=generator, device=device)
    counts = (draws[:, 0] * 11).long() * (draws[:, 1] < damage.outliers)
    shape = torch.repeat_interleave(torch.arange(meshes.size, device=device), counts)
    places = torch.rand((len(shape), 1, 3), generator=generator, device=device) - 0.5
    specks = places + _SPECK * torch.eye(3, device=device)
    return _joined(meshes, specks, shape)


def _with_holes(meshes: MeshBatch, damage: DamageRecipe, generator: torch.Generator) -> MeshBatch:
    """Remove the triangles whose centroid lies in a ball around a random triangle, for ``share`` of the shapes."""
    middle = meshes.middles
    draws = torch.rand((meshes.size, 3), generator=generator, device=middle.device)
    low, high = damage.radius
    radius = (low + (high - low) * draws[:, 1]) * (draws[:, 2] < damage.share)
    picked = _picked(meshes, draws[:, 0])
    dropped = (middle - middle[picked][meshes.shape]).norm(dim=1) < radius[meshes.shape]
    return _without(meshes, dropped, damage.least)


def _with_cuts(meshes: MeshBatch, damage: DamageRecipe, generator: torch.Generator) -> MeshBatch:
    """Remove the triangles beyond a plane of random direction through a random triangle, for ``cuts`` of the shapes."""
    return _without(meshes, _beyond(meshes, damage.cuts, generator), damage.least)


def _with_noise(meshes: MeshBatch, damage: DamageRecipe, generator: torch.Generator) -> MeshBatch:
    """Move the vertices of ``noise`` of the shapes at random; equal corners move together, so that no gaps open."""
    draws = torch.rand((meshes.size, 2), generator=generator, device=meshes.corners.device)
    deviation = damage.noise_size * draws[:, 0] * (draws[:, 1] < damage.noise)
    # A hash of the coordinates instead of a draw for every corner: triangles do not know which corners they share.
    hashes = meshes.corners @ torch.tensor(_HASH, device=meshes.corners.device) + 100.0 * draws[:1, :1]
    uniform = torch.sin(hashes) * 43758.547
    uniform = uniform - uniform.floor() - 0.5
    return MeshBatch(
        meshes.corners + (12.0**0.5 * deviation)[meshes.shape, None, None] * uniform, meshes.shape, meshes.size
    )


def _picked(meshes: MeshBatch, draws: Tensor) -> Tensor:
    """A random triangle of every shape, by ``draws`` ``(b,)`` in [0, 1): rows of ``corners``."""
    counts = meshes.counts
    return counts.cumsum(0) - counts + (draws * counts).long().clamp_max(counts - 1)


def _without(meshes: MeshBatch, dropped: Tensor, least: float) -> MeshBatch:
    """Without the triangles marked, but for shapes that would keep less than the share ``least`` of their area.

    One that all but vanishes teaches nothing.
    """
    areas = meshes.areas
    kept = meshes.per_shape(areas * ~dropped) >= least * meshes.per_shape(areas)
    return meshes.without(dropped & kept[meshes.shape])


def _with_clusters(meshes: MeshBatch, damage: DamageRecipe, generator: torch.Generator) -> MeshBatch:
    """Decimate ``clusters`` of the shapes: vertices that share a cell of a random grid become one (its corner)."""
    draws = torch.rand((meshes.size, 5), generator=generator, device=meshes.corners.device)
    size = (damage.cluster_size * draws[:, 0]).clamp_min(1e-6)[meshes.shape, None, None]
    shift = draws[meshes.shape, None, 1:4]
    snapped = ((meshes.corners / size + shift).round() - shift) * size
    merged = MeshBatch(snapped, meshes.shape, meshes.size)
    # What is thinner than a cell would vanish.
    kept = merged.per_shape(merged.areas) >= 0.5 * meshes.per_shape(meshes.areas)
    chosen = (kept & (draws[:, 4] < damage.clusters))[meshes.shape]
    return MeshBatch(torch.where(chosen[:, None, None], snapped, meshes.corners), meshes.shape, meshes.size)


def _with_doubled(meshes: MeshBatch, damage: DamageRecipe, generator: torch.Generator) -> MeshBatch:
    """Of ``doubled`` of the shapes the part beyond a random plane is duplicated: inner surfaces, repeated faces.

    Not a voxel changes, but centroid and inertia frame do, which weigh by area.
    """
    beyond = _beyond(meshes, damage.doubled, generator)
    return _joined(meshes, meshes.corners[beyond], meshes.shape[beyond])


def _with_spikes(meshes: MeshBatch, damage: DamageRecipe, generator: torch.Generator) -> MeshBatch:
    """``spikes`` of the shapes get a thin part that their symmetry does not know: an antenna, a sprue, a stray edge.

    A needle of random direction and up to ``spike_length`` stands on a random triangle. It weighs next to nothing, but
    may well be what the scale of the unit frame is measured by.
    """
    device = meshes.corners.device
    draws = torch.rand((meshes.size, 3), generator=generator, device=device)
    directions = torch.randn((meshes.size, 3), generator=generator, device=device)
    directions = directions / directions.norm(dim=1, keepdim=True)
    foot = meshes.middles[_picked(meshes, draws[:, 0])]
    tip = foot + damage.spike_length * draws[:, 1:2] * directions
    beside = foot + 0.004 * directions.roll(1, dims=1)
    needles = torch.stack([foot, beside, tip], dim=1)
    chosen = draws[:, 2] < damage.spikes
    return _joined(meshes, needles[chosen], torch.arange(meshes.size, device=device)[chosen])


def _beyond(meshes: MeshBatch, share: float, generator: torch.Generator) -> Tensor:
    """Triangles beyond a plane of random direction through a random triangle, for ``share`` of the shapes: ``(t,)``."""
    middle = meshes.middles
    draws = torch.rand((meshes.size, 2), generator=generator, device=middle.device)
    normals = torch.randn((meshes.size, 3), generator=generator, device=middle.device)
    normals = normals / normals.norm(dim=1, keepdim=True)
    height = (middle * normals[meshes.shape]).sum(1)
    beyond = height > height[_picked(meshes, draws[:, 0])][meshes.shape]
    return beyond & (draws[:, 1] < share)[meshes.shape]


def _joined(meshes: MeshBatch, corners: Tensor, shape: Tensor) -> MeshBatch:
    """With further triangles ``(n, 3, 3)`` of the shapes ``(n,)``."""
    order = torch.cat([meshes.shape, shape]).sort(stable=True)
    return MeshBatch(torch.cat([meshes.corners, corners])[order.indices], order.values, meshes.size)
