"""Error over time, beside what the belief says of its own error."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.export.figures.ground import DASHED, DOTTED, over_time
from pipeline.export.figures.paper import Paper, rgb
from pipeline.export.run import Run
from pipeline.geometry import wrap_angle

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

LEAST = (0.01, 0.1)
"""m and degrees that a logarithmic axis does not stretch below."""
MARKS = {"lost": ("lost", DOTTED), "found": ("found again", DASHED), "converged": ("converged", "-")}
"""Kinds of events that get a line: what it is called, and its dashes."""


def error(run: Run, paper: Paper) -> Figure:
    """Position and heading error over time with the belief's 2 sigma as a band; the spread where no truth is known."""
    theme = paper.theme
    figure = paper.figure((0.46 if paper.wide else 0.95) * paper.width)
    rows = figure.subplots(2, 1, sharex=True)
    position = position_error(run)
    turned = np.degrees(np.abs(wrap_angle(run.told.poses[:, 2] - run.scenes.truth[:, 2])))
    heading = None if position is None else turned
    what = ("position", "m"), ("heading", "deg")
    for k, (axes, found, sigma) in enumerate(zip(rows, (position, heading), sigmas(run), strict=True)):
        at, band = over_time(run, np.maximum(2.0 * sigma, LEAST[k]))
        colour = rgb(theme.hindsight)
        axes.fill_between(at, LEAST[k], band, color=colour, alpha=0.45, linewidth=0, label="2 sigma of the belief")
        axes.plot(at, band, color=colour, linewidth=0.5)
        if found is not None:
            shown = over_time(run, np.maximum(found, LEAST[k]))
            axes.plot(*shown, color=rgb(theme.estimate), linewidth=0.8, label="error", zorder=3)
        _events(axes, run, paper)
        draw_error(axes, f"{what[k][0]} {'spread' if found is None else 'error'} ({what[k][1]})")
        axes.set_ylim(LEAST[k], 1.5 * axes.get_ylim()[1])
        axes.set_xlim(run.scenes.times[0], run.scenes.times[-1])
    rows[1].set_xlabel("time since the first scan (s)")
    figure.align_ylabels(rows)
    paper.legend(figure)
    return figure


def draw_error(axes: Axes, label: str) -> None:
    """A logarithmic axis with plain numbers on it."""
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(lambda *_: "")
    axes.set_ylabel(label)
    axes.grid(visible=True)
    axes.spines[["top", "right"]].set_visible(False)


def position_error(run: Run) -> Array | None:
    """(n,) m from the truth, NaN where it is not known; None where it never is."""
    if np.isnan(run.scenes.truth).all():
        return None
    return np.hypot(*(run.told.poses[:, :2] - run.scenes.truth[:, :2]).T)


def sigmas(run: Run) -> tuple[Array, Array]:
    """(n,) m, along the longer axis of the position's ellipse, and (n,) degrees: the belief's standard deviations."""
    covariance = run.told.covariances
    widest = np.linalg.eigvalsh(covariance[:, :2, :2])[:, -1]
    return np.sqrt(np.maximum(widest, 0.0)), np.degrees(np.sqrt(np.maximum(covariance[:, 2, 2], 0.0)))


def _events(axes: Axes, run: Run, paper: Paper) -> None:
    named: set[str] = set()
    for event in run.told.events:
        if event.kind in MARKS:
            name, dashes = MARKS[event.kind]
            label = None if name in named else name
            axes.axvline(event.time, color=rgb(paper.theme.ink), linewidth=0.7, linestyle=dashes, label=label, zorder=2)
            named.add(name)
