"""Recovery against the rate of failures, as a picture: how often the robot is found again, and how soon."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.evaluate.aftermath import Aftermath
from pipeline.evaluate.failures import ANY, ELSEWHERE
from pipeline.evaluate.metrics import Summary, wilson_interval
from pipeline.evaluate.variants import PER_METRE, Comparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000", "#E69F00")
"""Okabe and Ito's palette: told apart by every kind of colour vision; markers differ as well."""
MARKERS = "osD^vP"
ASIDE = 1.02
"""Factor by which a curve is moved to the right of the one before, that its intervals can be told apart."""

Points = list[tuple[float, list[Aftermath]]]
"""Failures per metre, and what followed each of them."""


def plot_recovery(comparison: Comparison, path: str | Path) -> None:
    """Draw into the file ``path``, a PNG unless its suffix says otherwise, one row per log and one colour per variant.

    On the left the share of the failures after which the robot was found again, with its 95 % interval, on the right
    the median of the seconds, both against failures per metre; dashed, of those alone that put it elsewhere.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    logs = list(zip(*(done.logs for done in comparison.evaluations), strict=True))
    figure = Figure(figsize=(11, 3.6 * len(logs)), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    for (share, seconds), of_one in zip(figure.subplots(len(logs), 2, squeeze=False), logs, strict=True):
        labels = dict.fromkeys(comparison.label_without(PER_METRE, variant) for variant in comparison.variants)
        for k, label in enumerate(labels):
            for name, line in ((ANY, "-"), (ELSEWHERE, "--")):
                points: Points = [
                    (variant.failures, these)
                    for variant, log in zip(comparison.variants, of_one, strict=True)
                    if variant.failures is not None and comparison.label_without(PER_METRE, variant) == label
                    if (these := dict(log.faults).get(name))
                ]
                told = ": ".join(part for part in (label, name) if part)
                _curve(share, seconds, sorted(points, key=lambda point: point[0]), k, line, told)
        rates = sorted({variant.failures for variant in comparison.variants if variant.failures is not None})
        _finish(share, f"{of_one[0].name}: found again (%)", rates)
        share.set_ylim(0.0, 105.0)
        _finish(seconds, "after (s), median", rates)
        seconds.set_ylim(0.0, max(1.0, seconds.get_ylim()[1]))
        share.legend(frameon=False, fontsize=8, loc="lower left")
    figure.savefig(path)


def _curve(share: Axes, seconds: Axes, points: Points, k: int, line: str, label: str) -> None:
    colour, marker = COLOURS[k % len(COLOURS)], MARKERS[k % len(MARKERS)]
    style: dict[str, Any] = {"color": colour, "marker": marker, "linestyle": line, "linewidth": 1.4}
    rates = [rate * ASIDE**k for rate, _ in points]
    found = [sum(each.time is not None for each in these) for _, these in points]
    intervals = [wilson_interval(count, len(these)) for count, (_, these) in zip(found, points, strict=True)]
    shares = [100.0 * count / len(these) for count, (_, these) in zip(found, points, strict=True)]
    below = [value - 100.0 * low for value, (low, _) in zip(shares, intervals, strict=True)]
    above = [100.0 * high - value for value, (_, high) in zip(shares, intervals, strict=True)]
    share.errorbar(rates, shares, yerr=[below, above], capsize=3, label=label, **style)
    times = [Summary.of([each.time for each in these if each.time is not None]) for _, these in points]
    timed = [(rate, time.median) for rate, time in zip(rates, times, strict=True) if time is not None]
    seconds.plot([rate for rate, _ in timed], [median for _, median in timed], label=label, **style)


def _finish(axes: Axes, label: str, rates: list[float]) -> None:
    axes.set_xscale("log")
    axes.set_xticks(rates, [f"{rate:g}" for rate in rates])
    axes.set_xticks([], minor=True)
    axes.set_xlabel("failures per metre")
    axes.set_ylabel(label)
    axes.grid(alpha=0.25, linewidth=0.5)
    axes.spines[["top", "right"]].set_visible(False)
