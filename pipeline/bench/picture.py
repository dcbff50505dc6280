"""A benchmark's curves as a picture."""

from __future__ import annotations

from pathlib import Path

from pipeline.bench.measure import Benchmark


def plot(done: Benchmark, path: str | Path) -> None:
    """Draw the growth of costs into the file ``path``, a PNG unless its suffix says otherwise."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.6 * len(done.growth), 3.6), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)  # not pyplot: no display, no state left behind
    for axes, curve in zip(figure.subplots(1, len(done.growth), squeeze=False)[0], done.growth, strict=True):
        axes.plot(curve.points, curve.values, "o-", color="#0072B2")
        axes.set_xscale("log")
        axes.set_xticks(curve.points, [f"{p:,.0f}" for p in curve.points], rotation=45, minor=False)
        axes.minorticks_off()
        axes.set_ylim(bottom=0.0)
        axes.set_title(curve.name, fontsize=9)
        axes.set_xlabel(curve.over)
        axes.set_ylabel(curve.unit)
        axes.grid(alpha=0.3)
    figure.suptitle(f"{done.machine}, {done.cores} cores; {done.log}; median of {done.repeats}", fontsize=10)
    figure.savefig(path)
