"""Training curves as a picture."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from training.export import read_curve

_PANELS = (
    ("validation_loss", "validation loss", "linear"),
    ("validation_best_plane", "error of the best plane (training grid)", "log"),
    ("validation_share", "share of shapes with a plane under 4e-4 (training grid)", "linear"),
)


def draw_curves(runs: Sequence[Path], out: Path) -> None:
    """Draw loss, best plane and share over the steps, one line a run, into ``out`` (PNG or SVG)."""
    figure = Figure(figsize=(13, 3.8), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, (column, title, scale) in zip(figure.subplots(1, len(_PANELS)), _PANELS, strict=True):
        for run in runs:
            rows = [row for row in read_curve(run) if column in row]
            axes.plot([row["step"] for row in rows], [row[column] for row in rows], label=run.name)
        axes.set(title=title, xlabel="step", yscale=scale)
        axes.title.set_fontsize(10)
        axes.locator_params(axis="x", nbins=5)
        axes.grid(alpha=0.3)
        axes.legend()
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=110)
