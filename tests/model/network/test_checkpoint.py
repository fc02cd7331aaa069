"""A checkpoint comes back as it was saved, and anything that does not fit is refused with a reason."""

import json
from pathlib import Path

import pytest
import torch

from model.errors import CheckpointError
from model.network.architecture import Architecture
from model.network.checkpoint import InputSpec, load_checkpoint, save_checkpoint
from model.network.network import PRSNet

METADATA = {
    "name": "test", "version": "0", "input": {"frame": "inertia", "passes": 2, "sign_frames": 8, "views": 3},
    "recipe": {}, "seed": 0, "data": {}, "git_revision": "none", "metrics": {},
}  # fmt: skip


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    torch.manual_seed(0)
    path = tmp_path / "test.safetensors"
    save_checkpoint(path, PRSNet(Architecture(resolution=8, width=2, batch_norm=True)), METADATA)
    return path


def edit(path: Path, **changes: object) -> None:
    beside = path.with_suffix(".json")
    record = json.loads(beside.read_text())
    beside.write_text(json.dumps({**record, **changes}))


def test_comes_back_the_same_and_ready_for_inference(saved: Path):
    torch.manual_seed(0)
    original = PRSNet(Architecture(resolution=8, width=2, batch_norm=True)).state_dict()
    loaded = load_checkpoint(saved)
    assert loaded.network.architecture == Architecture(resolution=8, width=2, batch_norm=True)
    assert loaded.input == InputSpec("inertia", 2, 8, 3)
    assert not loaded.network.training
    for key, value in loaded.network.state_dict().items():
        assert torch.equal(value, original[key])
    assert not any(parameter.requires_grad for parameter in loaded.network.parameters())


def test_unknown_name_lists_what_is_shipped():
    with pytest.raises(CheckpointError, match="default"):
        load_checkpoint("no-such-weights")


def test_missing_metadata_is_named(saved: Path):
    saved.with_suffix(".json").unlink()
    with pytest.raises(CheckpointError, match=r"test\.json cannot be read"):
        load_checkpoint(saved)


def test_damaged_weights_are_noticed(saved: Path):
    content = bytearray(saved.read_bytes())
    content[-1] ^= 1
    saved.write_bytes(content)
    with pytest.raises(CheckpointError, match="sha256"):
        load_checkpoint(saved)


def test_another_architecture_does_not_fit(saved: Path):
    edit(saved, architecture={**Architecture(resolution=8, width=4, batch_norm=True).to_dict()})
    with pytest.raises(CheckpointError, match="does not fit"):
        load_checkpoint(saved)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"architecture": {"resolution": 33}}, "power of two"),
        ({"architecture": {"colour": 1}}, "does not fit"),
        ({"input": {"frame": "sideways"}}, "frame must be"),
        ({"format": 99}, "format 99"),
    ],
)
def test_metadata_that_makes_no_sense_is_refused(saved: Path, change: dict[str, object], message: str):
    edit(saved, **change)
    with pytest.raises(CheckpointError, match=message):
        load_checkpoint(saved)


@pytest.mark.parametrize("text", ["", "[1, 2]", "{", '{"format": 1}'])
def test_metadata_that_is_no_metadata_is_refused(saved: Path, text: str):
    saved.with_suffix(".json").write_text(text)
    with pytest.raises(CheckpointError):
        load_checkpoint(saved)


def test_weights_that_are_no_safetensors_are_refused(saved: Path):
    import hashlib

    saved.write_bytes(b"\x80\x04pickle")
    edit(saved, sha256=hashlib.sha256(b"\x80\x04pickle").hexdigest())
    with pytest.raises(CheckpointError, match="does not fit"):
        load_checkpoint(saved)


def test_incomplete_metadata_is_not_written(tmp_path: Path):
    with pytest.raises(CheckpointError, match="recipe"):
        save_checkpoint(tmp_path / "x.safetensors", PRSNet(), {"name": "x"})
    assert not list(tmp_path.iterdir())
