"""The belief at an instant: on the map, from near, and over the headings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.export.figures.ground import DASHED, DOTTED, aspect, draw_map
from pipeline.export.figures.paper import Paper, rgb
from pipeline.export.run import Run
from pipeline.recording import palette
from pipeline.recording.palette import Colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

CLOSE = 12.0
"""Metres that the close-up shows from side to side."""
HEADING_BIN = 5.0
"""Degrees."""


def belief(run: Run, row: int, paper: Paper) -> Figure:
    """Particles, hypotheses and estimate at a row of the run, on the whole map and near the robot, with its beams."""
    shape = min(aspect(run), 1.3)
    if paper.wide:
        side = (paper.width - 1.6) / (1.0 + 1.0 / shape)
        figure = paper.figure(side + 0.95)
        whole, near = figure.subplots(1, 2, width_ratios=(1.0, shape))
    else:
        figure = paper.figure(0.95 * paper.width * shape + 0.75 * paper.width + 0.7)
        whole, near = figure.subplots(2, 1, height_ratios=(shape, 0.75))
    x, y, _ = run.scenes.estimates[row]
    corner = np.array([x - CLOSE / 2, y - CLOSE / 2])
    draw_map(whole, run, paper)
    draw_map(near, run, paper, (corner, corner + CLOSE))
    _frame(whole, corner, paper)
    _beams(near, run, row, paper)
    for axes, grow in ((whole, 1.0), (near, 2.2)):
        _particles(axes, run, row, paper, grow)
        _ellipses(axes, run, row, paper)
    for axes in (whole, near):
        _robot(axes, run.scenes.truth[row], paper.theme.truth, paper, "truth", "s")
        _robot(axes, run.scenes.estimates[row], paper.theme.estimate, paper, "estimate, 2 sigma", "o")
    whole.set_title(f"{run.scenes.times[row]:.1f} s: spread {run.scenes.curves['spread'][row]:.1f} m", loc="left")
    _weights(figure, near, paper)
    paper.legend(figure)
    return figure


def headings(run: Run, row: int, paper: Paper) -> Figure:
    """How the belief is shared among the headings at a row of the run, with those of estimate and truth."""
    figure = paper.figure((0.36 if paper.wide else 0.7) * paper.width)
    axes, theme = figure.subplots(), paper.theme
    yaws = np.degrees(run.scenes.particles[row][:, 2].astype(np.float64))
    yaws = (yaws + 180.0) % 360.0 - 180.0
    edges = np.arange(-180.0, 180.0 + HEADING_BIN / 2, HEADING_BIN)
    weights = _shares(run, row)
    share, _ = np.histogram(yaws, edges, weights=100.0 * weights)
    count, _ = np.histogram(yaws, edges, weights=np.full(len(yaws), 100.0 / max(len(yaws), 1)))
    axes.stairs(share, edges, fill=True, color=rgb(theme.hindsight), label="belief")
    axes.stairs(count, edges, color=rgb(theme.ink), linewidth=0.8, label="particles")
    lines = [
        ("estimate", run.scenes.estimates[row], theme.estimate, DASHED),
        ("truth", run.scenes.truth[row], theme.truth, DOTTED),
    ]
    for name, pose, colour, dashes in lines:
        if not np.isnan(pose[2]):
            axes.axvline(np.degrees(pose[2]), color=rgb(colour), linestyle=dashes, linewidth=1.2, label=name)
    axes.set_xlim(-180, 180)
    axes.set_xticks(np.arange(-180, 181, 90 if not paper.wide else 45))
    axes.set_xlabel("heading (deg)")
    axes.set_ylabel(f"share, of {HEADING_BIN:g} deg each (%)")
    axes.set_title(f"{run.scenes.times[row]:.1f} s: {_told(run, row)}", loc="left")
    axes.spines[["top", "right"]].set_visible(False)
    paper.legend(figure)
    return figure


def undecided(run: Run) -> int:
    """The row that is shown unless a time is named: half way to where the belief converged, or the end."""
    if run.told.converged_at is None:
        return len(run.scenes) - 1
    return run.scenes.row_at(run.told.converged_at / 2)


def _told(run: Run, row: int) -> str:
    return f"{run.scenes.curves['particles'][row]:,.0f} particles, spread {run.scenes.curves['spread'][row]:.2f} m"


def _shares(run: Run, row: int) -> Array:
    """(m,) of the recorded particles' weights, as exact as the 16 levels that are recorded, adding up to one."""
    low, high = palette.COLOUR_RANGE
    levels = run.scenes.levels[row].astype(np.float64)
    weights = 10.0 ** (low + (levels + 0.5) * (high - low) / len(palette.WEIGHT_COLOURS))
    return weights / max(float(weights.sum()), 1e-300)


def _particles(axes: Axes, run: Run, row: int, paper: Paper, grow: float) -> None:
    particles, levels = run.scenes.particles[row], run.scenes.levels[row]
    order = np.argsort(levels, kind="stable")
    colours = paper.theme.weights[levels[order]] / 255.0
    x, y, _ = particles[order].T
    axes.scatter(x, y, s=1.2 * grow, c=colours, linewidths=0, zorder=4)


def _beams(axes: Axes, run: Run, row: int, paper: Paper) -> None:
    from matplotlib.collections import LineCollection

    scenes, theme = run.scenes, paper.theme
    start = scenes.lasers[row, :2]
    kinds: list[tuple[str, Any, Colour, Any, float]] = [
        ("beams that fit", scenes.hits, theme.hit, "-", 0.5),
        ("stopped short", scenes.shorts, theme.short, DASHED, 0.8),
        ("behind a wall", scenes.longs, theme.long, DOTTED, 0.8),
    ]
    for label, ends, colour, dashes, width in kinds:
        if len(ends[row]):
            rays = list(np.stack([np.broadcast_to(start, ends[row].shape), ends[row]], axis=1))
            drawn: dict[str, Any] = {"linewidths": width, "linestyles": dashes, "label": label, "zorder": 3}
            axes.add_collection(LineCollection(rays, colors=[rgb(colour)], **drawn), autolim=False)


def _ellipses(axes: Axes, run: Run, row: int, paper: Paper) -> None:
    from matplotlib.patches import Ellipse

    scenes, theme = run.scenes, paper.theme
    mine: dict[str, Any] = {"ec": rgb(theme.estimate), "lw": 1.0}
    others: dict[str, Any] = {"ec": rgb(theme.hypothesis), "lw": 0.8, "ls": DASHED}
    for which, drawn in ((scenes.hypotheses[row], others), (scenes.ellipses[row], mine)):
        for k, (x, y, a, b, turn) in enumerate(which):
            label = "other hypotheses, 2 sigma" if k == 0 and drawn is others else None
            shape = Ellipse((x, y), 2 * a, 2 * b, angle=np.degrees(turn), fill=False, zorder=5, label=label, **drawn)
            axes.add_patch(shape)


def _robot(axes: Axes, pose: Array, colour: Colour, paper: Paper, label: str, marker: str) -> None:
    if np.isnan(pose[0]):
        return
    x, y, yaw = pose
    ink, ground = rgb(colour), rgb(paper.theme.ground)
    axes.plot(x, y, marker=marker, markersize=5, markerfacecolor=ground, markeredgecolor=ink, markeredgewidth=1.2,
              linestyle="none", zorder=6, label=label)  # fmt: skip
    arrow = {
        "arrowstyle": "<|-,head_width=0.18,head_length=0.35",
        "color": ink,
        "lw": 1.2,
        "shrinkA": 0,
        "shrinkB": 2.5,
    }
    ahead = (14 * np.cos(yaw), 14 * np.sin(yaw))
    axes.annotate("", (x, y), ahead, textcoords="offset points", arrowprops=arrow, zorder=6)


def _frame(axes: Axes, corner: Array, paper: Paper) -> None:
    """Where the close-up is."""
    from matplotlib.patches import Rectangle

    x, y = corner
    axes.add_patch(Rectangle((x, y), CLOSE, CLOSE, fill=False, ec=rgb(paper.theme.ink), lw=0.6, zorder=5))


def _weights(figure: Figure, axes: Axes, paper: Paper) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, LogNorm

    low, high = palette.COLOUR_RANGE
    shades = ScalarMappable(LogNorm(10.0**low, 10.0**high), ListedColormap(paper.theme.weights / 255.0))
    bar = figure.colorbar(shades, ax=axes, label="weight / mean weight", aspect=28)
    bar.ax.minorticks_off()
    bar.ax.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
