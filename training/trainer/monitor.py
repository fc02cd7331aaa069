"""Early signs that a run goes wrong: outputs that do not depend on the input, gradients that are not finite."""

import math
from pathlib import Path

import torch

LEAST_NORMAL_STD = 1e-3
"""Standard deviation of the predicted normals over a batch: below it they do not depend on the input. Healthy networks
are above 0.05."""

LEAST_ROTATION_SINE = 0.05
"""The mean sine of half the angle of the rotations; at zero they are the identity. A half turn has 1."""

_LEAST_PATIENCE = 1000
_SHARE = 0.15
"""Share of a run without progress that is tolerated: the paper's network keeps its initial planes for the first 5 %."""


class CollapseError(RuntimeError):
    """The network has collapsed: what it predicts no longer depends on the input, or is no symmetry at all."""


class CollapseMonitor:
    """Watches ``normal_std`` and ``rotation_sine`` of the curve; both may be low for a while, but not for long.

    Args:
        steps: length of the run.
        rotations: whether the network has heads for rotations.
    """

    def __init__(self, steps: int, rotations: bool) -> None:
        self.patience = max(_LEAST_PATIENCE, round(_SHARE * steps))
        self._watched = {"normal_std": LEAST_NORMAL_STD} | ({"rotation_sine": LEAST_ROTATION_SINE} if rotations else {})
        self._since: dict[str, int] = {}
        self._warned: set[str] = set()

    def check(self, row: dict[str, float]) -> str | None:
        """Look at a line of the curve; a warning to be shown, once, when half of the patience is used up.

        Raises:
            CollapseError: a value has been too low for too long.
            FloatingPointError: the loss or the gradient is not finite.
        """
        step = int(row["step"])
        for key, name in (("loss", "loss"), ("gradient_norm", "gradient")):
            if not math.isfinite(row[key]):
                raise FloatingPointError(f"the {name} is not finite at step {step}; lower the learning rate")
        for key, least in self._watched.items():
            if row[key] >= least:
                self._since.pop(key, None)
                self._warned.discard(key)
                continue
            lasting = step - self._since.setdefault(key, step)
            if lasting >= self.patience:
                raise CollapseError(
                    f"{_MEANING[key]} for {lasting} steps, at step {step} ({key} {row[key]:.1e}): the network has "
                    "collapsed; lower the learning rate, or raise loss.regularization"
                )
            if lasting >= self.patience / 2 and key not in self._warned:
                self._warned.add(key)
                return (
                    f"warning: {_MEANING[key]} for {lasting} steps ({key} {row[key]:.1e}); the run ends at twice that"
                )
        return None


_MEANING = {
    "normal_std": "the predicted planes have not depended on the input",
    "rotation_sine": "the predicted rotations have been near the identity",
}


def memory_in_use(device: torch.device) -> str:
    """Memory of this process in words: its own, mapped files that the system can drop at any time, and a GPU's."""
    status = Path("/proc/self/status")
    parts: list[str] = []
    if status.is_file():
        fields = dict(line.split(":", 1) for line in status.read_text().splitlines() if ":" in line)
        if "RssAnon" in fields:
            own, mapped = (int(fields[key].split()[0]) // 1024 for key in ("RssAnon", "RssFile"))
            parts.append(f"{own} MB of memory, {mapped} MB of mapped files")
    if device.type == "cuda":
        parts.append(f"{torch.cuda.max_memory_allocated(device) // 2**20} MB on the GPU")
    return ", ".join(parts) or "memory unknown"
