"""Recovery against the rate of failures, as a picture: how often the robot is found again, and how soon."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.evaluate.aftermath import plain_aftermath
from pipeline.evaluate.failures import ANY
from pipeline.evaluate.metrics import wilson_interval
from pipeline.evaluate.variants import PER_METRE, Comparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000", "#E69F00")
"""Okabe and Ito's palette: told apart by every kind of colour vision; markers differ as well."""
MARKERS = "osD^vP"


def plot_recovery(comparison: Comparison, path: str | Path) -> None:
    """Draw into the file ``path``, a PNG unless its suffix says otherwise, one row per log and one curve per variant.

    On the left the share of the failures after which the robot was found again, with its 95 % interval, on the right
    the median of the seconds, both against failures per metre.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    logs = list(zip(*(done.logs for done in comparison.evaluations), strict=True))
    figure = Figure(figsize=(11, 3.6 * len(logs)), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    for (share, seconds), of_one in zip(figure.subplots(len(logs), 2, squeeze=False), logs, strict=True):
        curves: dict[str, list[tuple[float, int, int, float | None]]] = {}
        for variant, log in zip(comparison.variants, of_one, strict=True):
            these = dict(log.faults).get(ANY, [])
            if these and variant.failures is not None:
                told = plain_aftermath(ANY, these)
                time = None if told["time"] is None else told["time"]["median"]
                row = (variant.failures, told["found_again"], len(these), time)
                curves.setdefault(_label(comparison, variant.values), []).append(row)
        for k, (label, rows) in enumerate(curves.items()):
            _curve(share, seconds, k, label, sorted(rows, key=lambda row: row[0]))
        _finish(share, f"{of_one[0].name}: found again (%)", 105.0)
        _finish(seconds, "after (s), median", None)
        if len(curves) > 1:
            share.legend(frameon=False, fontsize=8, loc="lower left")
    figure.savefig(path)


def _label(comparison: Comparison, values: tuple[str, ...]) -> str:
    named = zip(comparison.keys, values, strict=True)
    return ", ".join(f"{key}={value}" for key, value in named if key != PER_METRE)


def _curve(share: Axes, seconds: Axes, k: int, label: str, rows: list[tuple[float, int, int, float | None]]) -> None:
    style: dict[str, Any] = {"color": COLOURS[k % len(COLOURS)], "marker": MARKERS[k % len(MARKERS)], "linewidth": 1.4}
    rates = [row[0] for row in rows]
    found = [100.0 * row[1] / row[2] for row in rows]
    intervals = [wilson_interval(row[1], row[2]) for row in rows]
    below = [value - 100.0 * low for value, (low, _) in zip(found, intervals, strict=True)]
    above = [100.0 * high - value for value, (_, high) in zip(found, intervals, strict=True)]
    share.errorbar(rates, found, yerr=[below, above], capsize=3, label=label, **style)
    timed = [(row[0], row[3]) for row in rows if row[3] is not None]
    if timed:
        seconds.plot(*zip(*timed, strict=True), label=label, **style)


def _finish(axes: Axes, label: str, top: float | None) -> None:
    axes.set_xscale("log")
    axes.set_xlabel("failures per metre")
    axes.set_ylabel(label)
    axes.set_ylim(bottom=0.0, top=top)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_minor_formatter(lambda *_: "")
    axes.grid(alpha=0.25, linewidth=0.5)
    axes.spines[["top", "right"]].set_visible(False)
