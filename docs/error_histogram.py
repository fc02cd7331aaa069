"""How the errors of all planes and axes of a ground-truth file are distributed: the picture behind the limits.

python docs/error_histogram.py docs/runs/groundtruth/corpus-test.json docs/images/errors.png
"""

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt

from training.oracle.truth import load


def main(source: Path, target: Path) -> None:
    """Print counts by decade and draw them."""
    truths = load(source).values()
    errors = np.array([e for t in truths for e in (*t.plane_errors, *(axis.error for axis in t.axes))])
    decades = np.concatenate([[0.0], 10.0 ** np.arange(-15, -2)])
    counts = np.histogram(errors, decades)[0]
    for low, high, count in zip(decades[:-1], decades[1:], counts, strict=True):
        print(f"| {low:.0e} to {high:.0e} | {count} |")
    figure, axes = plt.subplots(figsize=(8, 3), layout="constrained")
    axes.bar(range(len(counts)), counts, color="#4477aa")
    axes.set_xticks(range(len(counts)), [f"{high:.0e}" for high in decades[1:]], rotation=45, fontsize=8)
    axes.set_xlabel("symmetry error (SDE), up to")
    axes.set_ylabel("planes and axes")
    edges = [int(np.searchsorted(decades, limit * 1.001)) - 1.5 for limit in (1e-6,)]
    axes.axvline(edges[0], color="#cc3311", linestyle="--")
    axes.text(edges[0] - 0.1, counts.max() * 0.9, "exact", ha="right", color="#cc3311")
    axes.text(edges[0] + 0.1, counts.max() * 0.9, "similar", ha="left", color="#cc3311")
    figure.savefig(target, dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
