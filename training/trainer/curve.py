"""Training curves as a picture."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from training.trainer.export import read_curve

_PANELS = (
    ("validation_loss", "loss", "loss", "linear"),
    ("validation_best_plane", "best_plane", "error of the best plane (training grid)", "log"),
    ("validation_share", None, "share of shapes with a plane under 4e-4 (training grid)", "linear"),
)
"""Column of the validation, column of the training batches, title, scale."""


def draw_curves(runs: Sequence[Path], out: Path) -> None:
    """Draw loss, best plane and share over the steps, one colour a run, into ``out`` (PNG or SVG).

    Validation is a line with dots, the batches trained on are a faint one.
    """
    figure = Figure(figsize=(13, 3.8), layout="constrained")
    FigureCanvasAgg(figure)
    curves = [(run.name, read_curve(run)) for run in runs]
    for axes, (column, batches, title, scale) in zip(figure.subplots(1, len(_PANELS)), _PANELS, strict=True):
        for name, rows in curves:
            judged = [row for row in rows if column in row]
            line = axes.plot([row["step"] for row in judged], [row[column] for row in judged], ".-", label=name)[0]
            if batches is not None:
                values = [row[batches] for row in rows]
                axes.plot([row["step"] for row in rows], values, color=line.get_color(), alpha=0.3, linewidth=1)
        axes.set(title=title, xlabel="step", yscale=scale)
        axes.title.set_fontsize(10)
        axes.locator_params(axis="x", nbins=5)
        axes.grid(alpha=0.3)
        axes.legend()
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, dpi=110)
