"""Labels are true planes, the supervised loss measures what it says, and training with it gets closer to them."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from model.geometry.operations import Operations
from model.geometry.refinement import squared_distances
from model.geometry.surface import SurfaceIndex
from model.network.network import PRSNet
from tests.shapes import as_mesh, known
from tests.training.conftest import write_obj
from training.__main__ import app
from training.data.labels import Options, label
from training.data.mixture import Mixture
from training.data.prepare import Options as PrepareOptions
from training.data.prepare import prepare
from training.data.prepared import PreparedSet, dequantise
from training.data.store import ShapeStore
from training.inputs.inputs import Pose
from training.inputs.rotations import uniform_rotations
from training.oracle.groundtruth import groundtruth
from training.recipe import Recipe
from training.trainer.fit import fit
from training.trainer.objective import batch_losses
from training.trainer.supervision import PlaneLabels, Targets, canonical_planes, supervision

FAMILIES = {"box": 3, "mirror": 1, "none": 0}
"""Planes of a shape of each family."""

GUIDED = Recipe.from_dict({
    "name": "guided",
    "validation_share": 0.3,
    "network": {"resolution": 16, "batch_norm": True},
    "input": {"frame": "inertia", "jitters": [0.3], "jitter_shares": [1.0]},
    "loss": {"samples": 100, "regularization": 2.0},
    "supervision": {"weight": 100.0, "until_step": 60, "heads": 0.0},
    "optimizer": {"steps": 60, "batch": 8, "learning_rate": 0.005},
})  # fmt: skip


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> PreparedSet:
    """Boxes, mirrored and asymmetric shapes, and a vase: four of each, labelled by the scan with clear planes."""
    root = tmp_path_factory.mktemp("small")
    for seed in range(4):
        for family in (*FAMILIES, "vase"):
            mesh = as_mesh(known(family, seed))
            write_obj(root / "in" / family / f"{seed}.obj", mesh.vertices, mesh.faces)
    prepare([root / "in"], root / "out", PrepareOptions(samples=1000), progress=False)
    label(PreparedSet(root / "out"), Options(max_error=1e-6), progress=False)
    return PreparedSet(root / "out")


def surface_of(prepared: PreparedSet, index: int) -> tuple[SurfaceIndex, np.ndarray]:
    (v0, f0), (v1, f1) = prepared.arrays("starts")[0][index : index + 2]
    vertices = dequantise(prepared.arrays("vertices")[0][v0:v1]).astype(float)
    samples = dequantise(prepared.arrays("samples")[0][index]).astype(float)
    return SurfaceIndex(vertices, np.array(prepared.arrays("faces")[0][f0:f1])), samples


def test_labels_are_symmetries_of_their_shapes(small: PreparedSet):
    rows, families = small.arrays("planes")[0], small.arrays("families")[0]
    assert rows.shape == (16, 16, 5)
    for index, shape in enumerate(small.shapes):
        found = rows[index][np.isfinite(rows[index, :, 4])]
        surface, samples = surface_of(small, index)
        if shape.category == "vase":
            # Any plane through the axis mirrors a surface of revolution.
            direction, point = families[index, :3].astype(float), families[index, 3:].astype(float)
            normal = np.cross(direction, [0.3, -0.5, 0.8])
            normal /= np.linalg.norm(normal)
            planes = np.append(normal, -normal @ point)[None]
        else:
            assert len(found) == FAMILIES[shape.category], shape.name
            assert not families[index].any()
            planes = found[:, :4].astype(float)
        if len(planes):
            assert squared_distances(surface, samples, Operations.reflections(planes)).mean(1).max() < 1e-6
    record = small.labels
    assert record is not None
    assert (record["planes"], record["axes"], record["labelled"]) == (16, 4, 12)


def test_ground_truth_gives_the_same_planes(small: PreparedSet, tmp_path: Path):
    folder = tmp_path / "in"
    for family in ("box", "mirror"):
        mesh = as_mesh(known(family, 0))
        write_obj(folder / family / "0.obj", mesh.vertices, mesh.faces)
    prepare([folder], tmp_path / "out", PrepareOptions(mesh_only=True), progress=False)
    groundtruth([folder], tmp_path / "truth.json", progress=False)
    prepared = PreparedSet(tmp_path / "out")
    label(prepared, Options("groundtruth"), tmp_path / "truth.json", progress=False)
    rows = PreparedSet(tmp_path / "out").arrays("planes")[0]
    other = small.arrays("planes")[0]
    for name, count in (("in/box/0.obj", 3), ("in/mirror/0.obj", 1)):
        mine = rows[[shape.name for shape in prepared.shapes].index(name)][:count, :4]
        theirs = other[[shape.name for shape in small.shapes].index(name)][:count, :4]
        inner = np.abs(mine @ theirs.T).max(1)
        np.testing.assert_allclose(inner, (mine**2).sum(1), atol=1e-4)


def test_labelling_resumes_and_changes_with_the_method(small: PreparedSet, tmp_path: Path):
    runner = CliRunner()
    folder = tmp_path / "in"
    mesh = as_mesh(known("box", 1))
    write_obj(folder / "box.obj", mesh.vertices, mesh.faces)
    prepare([folder], tmp_path / "set", PrepareOptions(mesh_only=True), progress=False)
    result = runner.invoke(app, ["label", str(tmp_path / "set"), "--method", "pca", "--no-progress"])
    assert "1 of 1 shapes labelled: 3 planes, 0 continuous axes" in result.output
    first = (tmp_path / "set" / "shard-00000" / "planes.npy").stat().st_mtime_ns
    runner.invoke(app, ["label", str(tmp_path / "set"), "--method", "pca", "--no-progress"])
    assert (tmp_path / "set" / "shard-00000" / "planes.npy").stat().st_mtime_ns == first
    runner.invoke(app, ["label", str(tmp_path / "set"), "--planes", "2", "--no-progress"])
    record = json.loads((tmp_path / "set" / "labels.json").read_text())
    assert (record["options"]["method"], record["planes"]) == ("scan", 2)
    for arguments, message in ((["--method", "guess"], "the method is one of"), (["--method", "groundtruth"], "needs")):
        result = runner.invoke(app, ["label", str(tmp_path / "set"), *arguments])
        assert result.exit_code == 2
        assert message in " ".join(result.output.replace("│", " ").split())


def test_planes_of_the_fed_frame_reach_the_canonical_one():
    generator = torch.Generator().manual_seed(3)
    pose = Pose(uniform_rotations(5, generator, torch.device("cpu")), torch.randn(5, 3, generator=generator) * 0.1,
                torch.rand(5, generator=generator) + 0.5)  # fmt: skip
    normals = torch.nn.functional.normalize(torch.randn(5, 2, 3, generator=generator), dim=-1)
    planes = torch.cat([normals, torch.randn(5, 2, 1, generator=generator) * 0.2], dim=-1)
    points = torch.randn(5, 30, 3, generator=generator)
    fed = (points - pose.center[:, None]) @ pose.rotation.mT / pose.scale[:, None, None]
    heights = fed @ planes[..., :3].mT + planes[:, None, :, 3]
    moved = canonical_planes(planes, pose)
    expected = points @ moved[..., :3].mT + moved[:, None, :, 3]
    torch.testing.assert_close(heights * pose.scale[:, None, None], expected)


def targets(rows: list[list[float]], direction: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Targets:
    planes = torch.zeros(1, 4, 4)
    planes[0, : len(rows)] = torch.tensor(rows).view(-1, 4)
    return Targets(planes, torch.arange(4)[None] < len(rows), torch.tensor([direction]), torch.zeros(1, 3))


X, Y, Z = [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]


def test_the_supervised_loss_is_the_ground_truth_error_of_nearest_planes():
    heads = torch.tensor([[X, Y, Z]])
    assert supervision(heads, targets([Y, [-1.0, 0.0, 0.0, 0.0], Z]), 1.0).item() == pytest.approx(0.0, abs=1e-6)
    # One known plane: its nearest head is 0.1 off, the two others are perpendicular to it.
    moved = targets([[-1.0, 0.0, 0.0, 0.1]])
    assert supervision(heads, moved, 0.0).item() == pytest.approx(0.01, abs=1e-6)
    assert supervision(heads, moved, 1.0).item() == pytest.approx(0.01 + (0.01 + 2.01 + 2.01) / 3, abs=1e-5)
    # More known planes than heads: the fourth asks for nothing.
    diagonal = [0.5**0.5, 0.5**0.5, 0.0, 0.0]
    assert supervision(heads, targets([X, Y, Z, diagonal]), 1.0).item() == pytest.approx(0.0, abs=1e-6)
    assert supervision(heads, targets([]), 1.0).item() == 0.0


def test_planes_through_a_continuous_axis_are_one_target():
    slanted = torch.tensor([[[0.6, 0.8, 0.0, 0.0], X, Y]])
    assert supervision(slanted, targets([], (0.0, 0.0, 1.0)), 1.0).item() == pytest.approx(0.0, abs=1e-6)
    off = torch.tensor([[[0.6, 0.8, 0.0, 0.2], X, Y]])
    assert supervision(off, targets([], (0.0, 0.0, 1.0)), 1.0).item() == pytest.approx(0.04 / 3, abs=1e-6)


@pytest.mark.parametrize("rows", [[], [X], [X, Y, Z, [0.6, 0.8, 0.0, 0.0]]])
def test_gradients_are_finite_and_descend(rows: list[list[float]]):
    heads = torch.nn.functional.normalize(torch.randn(1, 3, 4, generator=torch.Generator().manual_seed(1)), dim=-1)
    heads.requires_grad_()
    loss = supervision(heads, targets(rows), 1.0).sum()
    loss.backward()
    assert heads.grad is not None
    assert heads.grad.isfinite().all()
    if rows:
        assert supervision(heads.detach() - 1e-3 * heads.grad, targets(rows), 1.0).sum() < loss


def column(run: Path, key: str) -> list[float]:
    with (run / "curve.csv").open(newline="") as lines:
        return [float(row[key]) for row in csv.DictReader(lines) if row[key]]


def test_supervision_brings_heads_to_the_known_planes(small: PreparedSet):
    """On one batch, in one pose: the planes in the frame of the labels, the gradient through that frame."""
    cpu = torch.device("cpu")
    store, labels = ShapeStore(small, cpu, GUIDED.loss.grid), PlaneLabels(small, cpu, 1e-4)
    torch.manual_seed(0)
    network = PRSNet(GUIDED.network)
    optimizer = torch.optim.Adam(network.parameters(), lr=0.01)
    values: list[float] = []
    for _ in range(40):
        generator = torch.Generator().manual_seed(5)
        guided = batch_losses(network, store, torch.arange(len(small)), GUIDED, generator, labels).supervision
        optimizer.zero_grad()
        guided.backward()
        optimizer.step()
        values.append(float(guided.detach()))
    assert values[-1] < 0.3 * values[0]


def test_a_guided_run_says_so(small: PreparedSet, tmp_path: Path):
    fit(GUIDED.replace(optimizer={"steps": 4}), small, tmp_path, device="cpu", log_every=2, validate_every=4)
    assert len(column(tmp_path, "supervision")) == 2
    assert len(column(tmp_path, "validation_supervision")) == 1
    data = json.loads((tmp_path / "run.json").read_text())["data"]
    assert data["labels"]["sha256"] == (small.labels or {})["sha256"]


def test_supervision_ends_where_the_recipe_says():
    recipe = GUIDED.supervision
    assert [recipe.weight_at(step) for step in (0, 59, 60, 1000)] == [100.0, 100.0, 0.0, 0.0]
    always = GUIDED.replace(supervision={"until_step": 0}).supervision
    assert always.weight_at(10**6) == 100.0


def test_sets_labelled_with_different_numbers_of_planes_mix(small: PreparedSet, tmp_path: Path):
    mesh = as_mesh(known("box", 7))
    write_obj(tmp_path / "in" / "box.obj", mesh.vertices, mesh.faces)
    prepare([tmp_path / "in"], tmp_path / "out", PrepareOptions(mesh_only=True), progress=False)
    other = PreparedSet(tmp_path / "out")
    with pytest.raises(ValueError, match="or a set mixed into it, has no labels"):
        PlaneLabels(Mixture(small, [(other, 0.5)]), torch.device("cpu"), 1e-6)
    label(other, Options(planes=2), progress=False)
    labels = PlaneLabels(Mixture(small, [(PreparedSet(other.root), 0.5)]), torch.device("cpu"), 1e-6)
    found = labels.of(torch.tensor([0, 16]))
    assert found.known.sum(1).tolist() == [3, 2]
    assert found.planes.isfinite().all()


def test_a_set_without_labels_is_refused(prepared: PreparedSet, tmp_path: Path):
    with pytest.raises(ValueError, match="run `training label` first"):
        fit(GUIDED, prepared, tmp_path, device="cpu")
    with pytest.raises(ValueError, match="run `training label` first"):
        PlaneLabels(prepared, torch.device("cpu"), 1e-4)
