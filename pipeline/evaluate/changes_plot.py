"""Localization against the share of the seen wall that the map has wrong, as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.evaluate.metrics import Summary, wilson_interval
from pipeline.evaluate.perturbed import UNCHANGED
from pipeline.evaluate.recovery_plot import COLOURS, MARKERS
from pipeline.evaluate.report import LogEvaluation
from pipeline.evaluate.variants import MAP, Comparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ASIDE = 0.3
"""Percent by which a curve is moved to the right of the one before, that its intervals can be told apart."""


def plot_changes(comparison: Comparison, path: str | Path) -> None:
    """Draw into the file ``path``, a PNG unless its suffix says otherwise, one row per log and one curve per kind.

    From the left: the share of runs that succeed, with its 95 % interval, the scans that are right (median over runs),
    and the position error since the robot was found (median), against the share of the seen wall that was changed.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    logs = list(zip(*(done.logs for done in comparison.evaluations), strict=True))
    figure = Figure(figsize=(15, 3.8 * len(logs)), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    curves = dict.fromkeys(
        (comparison.label_without(MAP, variant), variant.change.kind)
        for variant in comparison.variants
        if variant.change is not None and variant.change.kind != UNCHANGED
    )
    for panels, of_one in zip(figure.subplots(len(logs), 3, squeeze=False), logs, strict=True):
        for k, (label, kind) in enumerate(curves or {("", UNCHANGED): None}):
            points = [
                log
                for variant, log in zip(comparison.variants, of_one, strict=True)
                if variant.change is not None
                and comparison.label_without(MAP, variant) == label
                and variant.change.kind in (kind, UNCHANGED)
            ]
            _curve(panels, points, k, ", ".join(part for part in (label, kind) if part))
        name = of_one[0].name
        for axes, told in zip(panels, ("success (%)", "scans right (%)", "error since found (m)"), strict=True):
            axes.set_xlabel("seen wall that is wrong (%)")
            axes.set_ylabel(f"{name}: {told}")
            axes.grid(alpha=0.25, linewidth=0.5)
            axes.spines[["top", "right"]].set_visible(False)
        for axes in panels[:2]:
            axes.set_ylim(0.0, 105.0)
        panels[2].set_ylim(bottom=0.0)
        panels[0].legend(frameon=False, fontsize=8, loc="lower left")
    figure.savefig(path)


def _curve(panels: tuple[Axes, Axes, Axes], logs: list[LogEvaluation], k: int, label: str) -> None:
    style: dict[str, Any] = {
        "color": COLOURS[k % len(COLOURS)], "marker": MARKERS[k % len(MARKERS)], "linewidth": 1.4, "label": label,
    }  # fmt: skip
    logs = sorted(logs, key=_share)
    shares = [_share(log) + ASIDE * k for log in logs]
    rates = [100.0 * log.success_rate for log in logs]
    intervals = [wilson_interval(log.successes, len(log.runs)) for log in logs]
    below = [rate - 100.0 * low for rate, (low, _) in zip(rates, intervals, strict=True)]
    above = [100.0 * high - rate for rate, (_, high) in zip(rates, intervals, strict=True)]
    success, right, error = panels
    success.errorbar(shares, rates, yerr=[below, above], capsize=3, **style)
    medians = [log.over_runs(lambda score: score.scans_right) for log in logs]
    right.plot(shares, [100.0 * each.median if each else np.nan for each in medians], **style)
    errors = [Summary.of(log.errors_since_found[0]) for log in logs]
    told = [(share, each.median) for share, each in zip(shares, errors, strict=True) if each is not None]
    error.plot([share for share, _ in told], [median for _, median in told], **style)


def _share(log: LogEvaluation) -> float:
    """Of the seen wall, percent that was really changed, the mean over runs."""
    return 100.0 * float(np.mean([run.map_changed or 0.0 for run in log.runs]))
