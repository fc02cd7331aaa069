"""Which shapes a step sees: in its group every shape equally often, groups as the recipe says, sets by their shares."""

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from tests.shapes import box
from tests.training.conftest import write_obj
from training.__main__ import app
from training.data.batch_sampler import Sampler
from training.data.mixture import Mixture
from training.data.prepare import Options, prepare
from training.data.prepared import PreparedSet
from training.data.store import MappedArrays, ShapeStore
from training.recipe import Recipe

SIZES = {"chair": 24, "lamp": 6, "plane": 2}


@pytest.fixture(scope="module")
def uneven(tmp_path_factory: pytest.TempPathFactory) -> PreparedSet:
    """Boxes in three categories of very different size."""
    root = tmp_path_factory.mktemp("uneven")
    for category, count in SIZES.items():
        for index in range(count):
            shape = box(1.0, 1.0 + 0.1 * index, 3.0)
            write_obj(root / "in" / category / f"{index}.obj", shape.vertices, shape.faces)
    prepare([root / "in"], root / "out", Options(mesh_only=True), progress=False)
    return PreparedSet(root / "out")


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> PreparedSet:
    """Five more boxes, to be mixed in."""
    root = tmp_path_factory.mktemp("other")
    for index in range(5):
        shape = box(1.0, 1.0, 1.2 + index)
        write_obj(root / "in" / f"{index}.obj", shape.vertices, shape.faces)
    prepare([root / "in"], root / "out", Options(mesh_only=True), progress=False)
    return PreparedSet(root / "out")


def recipe(batch: int = 8, **sampling: object) -> Recipe:
    return Recipe.from_dict({"name": "x", "sampling": sampling, "optimizer": {"batch": batch}})


def drawn(sampler: Sampler, steps: int, first: int = 0) -> list[int]:
    return torch.cat([sampler.draw(step) for step in range(first, first + steps)]).tolist()


def categories(prepared: PreparedSet, shapes: list[int]) -> Counter[str]:
    return Counter(prepared.shapes[shape].category for shape in shapes)


def test_an_epoch_may_go_through_a_few_shards_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Every shape comes once, in an order that differs from epoch to epoch, and few shards are in use at any time."""
    for index in range(48):
        shape = box(1.0, 1.0 + 0.1 * index, 3.0)
        write_obj(tmp_path / "in" / f"{index:02d}.obj", shape.vertices, shape.faces)
    monkeypatch.setattr("training.data.prepare.SHARD_SHAPES", 4)
    prepare([tmp_path / "in"], tmp_path / "out", Options(mesh_only=True), progress=False)
    many = PreparedSet(tmp_path / "out")
    shard_of = many.locations()[0]
    assert len(set(shard_of.tolist())) == 12
    orders = list[list[int]]()
    for epoch in range(2):
        sampler = Sampler(many, np.arange(48), recipe(batch=4, shards=3))
        order = drawn(sampler, 12, first=12 * epoch)
        assert sorted(order) == list(range(48))
        windows = [set(shard_of[order[first : first + 12]].tolist()) for first in range(0, 48, 12)]
        assert all(len(window) == 3 for window in windows)
        assert len(set.union(*windows)) == 12
        assert any(len(set(shard_of[order[first : first + 4]].tolist())) > 1 for first in range(0, 48, 4))
        orders.append(order)
    assert orders[0] != orders[1]
    everywhere = drawn(Sampler(many, np.arange(48), recipe(batch=4)), 3)
    assert len(set(shard_of[everywhere].tolist())) > 3


def test_every_shape_is_seen_once_an_epoch(uneven: PreparedSet):
    pool = np.arange(2, 32)
    sampler = Sampler(uneven, pool, recipe(batch=10))
    epoch, following = drawn(sampler, 3), drawn(sampler, 3, first=3)
    assert sorted(epoch) == sorted(following) == pool.tolist()
    assert epoch != following


def test_a_step_depends_on_nothing_but_the_step(uneven: PreparedSet):
    """As a resumed run needs it: steps drawn in any order are the same."""
    forward = Sampler(uneven, np.arange(32), recipe(balance="category", power=0.5))
    backward = Sampler(uneven, np.arange(32), recipe(balance="category", power=0.5))
    steps = [forward.draw(step).tolist() for step in range(20)]
    assert [backward.draw(step).tolist() for step in reversed(range(20))] == steps[::-1]
    reseeded = Sampler(uneven, np.arange(32), recipe(balance="category", power=0.5).replace(seed=3))
    assert reseeded.draw(0).tolist() != steps[0]


def test_power_one_makes_categories_equal_and_zero_leaves_them(uneven: PreparedSet):
    pool = np.arange(32)
    shares = {}
    for power in (0.0, 0.5, 1.0):
        sampler = Sampler(uneven, pool, recipe(batch=1, balance="category", power=power))
        shares[power] = categories(uneven, drawn(sampler, 32))
    assert shares[0.0] == SIZES
    assert max(shares[1.0].values()) - min(shares[1.0].values()) <= 1
    roots = {name: size**0.5 for name, size in SIZES.items()}
    for name, root in roots.items():
        assert shares[0.5][name] == pytest.approx(32 * root / sum(roots.values()), abs=0.5)


def test_within_a_group_all_shapes_come_before_one_comes_again(uneven: PreparedSet):
    """Equal shares draw 11 of 24 chairs an epoch: after any number of epochs counts differ by at most one."""
    sampler = Sampler(uneven, np.arange(32), recipe(batch=1, balance="category"))
    epoch = sum(group.draws for group in sampler.groups)
    counts: Counter[int] = Counter()
    for number in range(7):
        counts.update(drawn(sampler, epoch, first=number * epoch))
        for group in sampler.groups:
            seen = [counts[member] for member in group.members.tolist()]
            assert max(seen) - min(seen) <= 1


def test_an_epoch_of_so_many_models_a_category(uneven: PreparedSet):
    """The paper's 4,000 augmented models a category (section 6.1), here 40."""
    sampler = Sampler(uneven, np.arange(32), recipe(batch=1, balance="category", per_category=40))
    assert categories(uneven, drawn(sampler, 120)) == dict.fromkeys(SIZES, 40)
    with pytest.raises(ValueError, match=r"needs sampling\.balance"):
        recipe(per_category=40)
    with pytest.raises(ValueError, match="between 0 and 1"):
        recipe(balance="source", power=2.0)


def test_a_mixture_draws_the_stated_share_of_each_set(uneven: PreparedSet, other: PreparedSet):
    mixture = Mixture(uneven, [(other, 0.2)])
    train, held_out = mixture.split(0.3)
    sampler = Sampler(mixture, train, recipe(batch=1))
    epoch = drawn(sampler, sum(group.draws for group in sampler.groups))
    main = len(uneven.split(0.3)[0])
    assert len(epoch) == round(main / 0.8)
    assert sum(shape >= len(uneven) for shape in epoch) == round(0.2 / 0.8 * main)
    # Validation is that of the main set alone.
    np.testing.assert_array_equal(held_out, uneven.split(0.3)[1])
    balanced = Sampler(mixture, train, recipe(batch=1, balance="category"))
    epoch = drawn(balanced, sum(group.draws for group in balanced.groups))
    assert sum(shape >= len(uneven) for shape in epoch) / len(epoch) == pytest.approx(0.2, abs=0.02)


def test_a_mixture_hands_out_the_shapes_of_all_its_sets(uneven: PreparedSet, other: PreparedSet):
    mixture = Mixture(uneven, [(other, 0.5)])
    store = ShapeStore(mixture, torch.device("cpu"), 16)
    alone = MappedArrays(other, torch.device("cpu"), 16, None)
    assert len(mixture) == 37
    mine, theirs = store.meshes(torch.tensor([33])), alone.meshes(torch.tensor([1]))
    assert torch.equal(mine.corners, theirs.corners)


def test_the_hash_covers_every_set_and_its_share(uneven: PreparedSet, other: PreparedSet):
    hashes = {
        uneven.sha256,
        Mixture(uneven, [(other, 0.2)]).sha256,
        Mixture(uneven, [(other, 0.3)]).sha256,
        Mixture(other, [(uneven, 0.2)]).sha256,
    }
    assert len(hashes) == 4
    assert Mixture(uneven, [(other, 0.2)]).sha256 in hashes


@pytest.mark.parametrize("shares", [(0.0,), (-0.1,), (1.0,), (0.5, 0.6)])
def test_impossible_shares_are_refused(uneven: PreparedSet, other: PreparedSet, shares: tuple[float, ...]):
    with pytest.raises(ValueError, match="shares of sets"):
        Mixture(uneven, [(other, share) for share in shares])


def test_fit_mixes_sets(uneven: PreparedSet, other: PreparedSet, tmp_path: Path):
    toml = tmp_path / "tiny.toml"
    toml.write_text(
        'name = "tiny"\n[network]\nresolution = 8\n[loss]\nsamples = 50\ngrid = 8\n[optimizer]\nsteps = 2\nbatch = 4\n'
    )
    start = ["fit", str(uneven.root), "--run", str(tmp_path / "run"), "--recipe", str(toml), "--device", "cpu"]
    options = [*start, "--no-tensorboard", "--no-progress"]
    result = CliRunner().invoke(app, [*options, "--mix", f"{other.root}:0.25"])
    assert result.exit_code == 0, result.output
    data = json.loads((tmp_path / "run" / "run.json").read_text())["data"]
    assert [(part["shapes"], part["share"]) for part in data["sets"]] == [(32, 0.75), (5, 0.25)]
    assert data["manifest_sha256"] == Mixture(uneven, [(other, 0.25)]).sha256
    # Without the mixture it is another run.
    assert "another recipe or other data" in " ".join(CliRunner().invoke(app, options).output.split())
    result = CliRunner().invoke(app, [*options, "--mix", str(other.root)])
    assert result.exit_code == 2
    assert "PREPARED:SHARE" in result.output
