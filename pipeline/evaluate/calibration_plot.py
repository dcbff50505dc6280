"""Calibration as a picture: what was stated against what was right, and how often it was stated."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pipeline.evaluate.calibration import BINS, Calibration
from pipeline.evaluate.plots import GOOD, LIMIT


def plot_calibration(told: Sequence[tuple[str, Calibration]], path: str | Path) -> None:
    """Draw into the file ``path``, a PNG unless its suffix says otherwise, one row per named calibration.

    On the left the share of scans that were right against the stated probability, with its 95 % interval over runs,
    and the diagonal on which they would be equal; on the right how many scans were in each bin.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.4 * len(told)), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    for (left, right), (name, calibration) in zip(figure.subplots(len(told), 2, squeeze=False), told, strict=True):
        left.plot([0, 1], [0, 1], color=LIMIT, linewidth=1, linestyle="--")
        for each in calibration.bins:
            value = each.right.value
            if each.stated is None or value is None:
                continue
            low, high = each.right.low, each.right.high
            about = None if low is None or high is None else [[max(value - low, 0.0)], [max(high - value, 0.0)]]
            left.errorbar([each.stated], [value], yerr=about, color=GOOD, marker="o", capsize=3)
        left.set_xlim(-0.02, 1.02)
        left.set_ylim(-0.02, 1.02)
        left.set_aspect("equal")
        left.set_xlabel("stated probability")
        left.set_ylabel(f"{name}: share that was right")
        right.bar(range(len(calibration.bins)), [each.scans for each in calibration.bins], color=GOOD)
        right.set_xticks(range(len(calibration.bins)), [f"{low:g}" for low in BINS[:-1]])
        right.set_yscale("symlog", linthresh=10)
        right.set_xlabel("stated probability, from")
        right.set_ylabel("scans")
        for axes in (left, right):
            axes.grid(alpha=0.25, linewidth=0.5)
            axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path)
