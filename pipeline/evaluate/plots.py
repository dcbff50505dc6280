"""An evaluation as a picture: errors over time on the left, the paths on the map on the right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.evaluate.metrics import LOCALIZED, Array, Summary, known, pose_errors
from pipeline.evaluate.report import Evaluation, LogEvaluation
from pipeline.evaluate.variants import Comparison
from pipeline.maps.occupancy_grid import OccupancyGrid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

# Okabe and Ito's palette, told apart by every kind of colour vision; success and failure differ in lightness as well.
GOOD, BAD, TRUTH, LIMIT = "#0072B2", "#D55E00", "#000000", "#666666"
UNKNOWN = 0.9
"""Grey level of what the map does not know."""
POINTS = 2000
"""A curve has at most so many points: more than the picture has columns."""
JUMP = 1.0
"""m: where an estimate leaps farther from one point to the next, its path is broken, not drawn across the map."""


HIGHEST = 60_000
"""Pixels: no picture can be higher than 65,536, so one with very many rows gets smaller."""


def plot(evaluations: Evaluation | Comparison, output: str | Path) -> None:
    """Draw one row per log into the file ``output``, a PNG unless its suffix says otherwise; of a comparison log by log
    one row per variant."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if isinstance(evaluations, Comparison):
        by_log = zip(*(done.logs for done in evaluations.evaluations), strict=True)
        labels = [", ".join(f"{k}={v}" for k, v in zip(evaluations.keys, one.values, strict=True))
                  for one in evaluations.variants]  # fmt: skip
        drawn = [(f"{log.name}, {label}", log) for logs in by_log for label, log in zip(labels, logs, strict=True)]
    else:
        drawn = [(log.name, log) for log in evaluations.logs]
    height = 6.2 * len(drawn)
    figure = Figure(figsize=(14, height), dpi=min(120.0, HIGHEST / height), layout="constrained")
    FigureCanvasAgg(figure)  # not pyplot: no display, no state left behind
    rows = figure.subfigures(len(drawn), 1, squeeze=False)[:, 0]
    for row, (title, log) in zip(rows, drawn, strict=True):
        _draw(row, title, log)
    figure.savefig(output)


def _draw(figure: SubFigure, title: str, log: LogEvaluation) -> None:
    told, shown = _told(log), _Shown.of(log)
    left, right = figure.subfigures(1, 2, squeeze=False)[0]
    position, heading = left.subplots(2, 1, sharex=True)
    _errors(position, heading, shown)
    _map(right.subplots(), shown)
    figure.suptitle(f"{title}: {told}", fontsize=14, fontweight="bold")


@dataclass(frozen=True)
class _Shown:
    """A log's runs and what they are drawn against: the truth, or, where nobody knows it, where most of them are.

    ``good``: which of the runs succeed, or end where most do; the rest are the words for it.
    """

    log: LogEvaluation
    good: tuple[bool, ...]
    error: str
    reference: str
    well: str
    badly: str

    @classmethod
    def of(cls, log: LogEvaluation) -> _Shown:
        if log.scored or log.agreement is None:
            good = tuple(run.success for run in log.runs)
            return cls(log, good, "error", "reference", "succeed", "fail")
        middle = log.agreement.middle
        runs = tuple(replace(run, truth=middle) for run in log.runs)
        good = tuple(log.agreement.with_middle[:, -1].tolist())
        drawn = replace(log, truth=middle, runs=runs)
        return cls(drawn, good, "from most runs", "where most runs are", "end there", "end elsewhere")


def _told(log: LogEvaluation) -> str:
    if not log.scored and log.agreement is not None:
        together = log.agreement.all.together
        said = (
            "one run" if together is None else f"{len(log.runs)} runs, together at {100 * together:.0f} % of the scans"
        )
        return f"{said}; the truth is not known"
    error = Summary.of(log.errors_since_found[0])
    median = f"median error {error.median:.2f} m" if error else "never localized"
    return f"{log.successes} of {len(log.runs)} runs succeed ({100 * log.success_rate:.0f} %), {median}"


def _errors(position: Axes, heading: Axes, shown: _Shown) -> None:
    log = shown.log
    curves = [
        [np.column_stack([run.times, error])[_thin(len(run.times))] for error in _floored(run.poses, run.truth)]
        for run in log.runs
    ]
    for axes, k, limit, label in (
        (position, 0, LOCALIZED[0], f"position {shown.error} (m)"),
        (heading, 1, float(np.degrees(LOCALIZED[1])), f"heading {shown.error} (deg)"),
    ):
        _lines(axes, [c[k] for c in curves], shown)
        _median(axes, [c[k] for c in curves], shown)
        axes.axhline(limit, color=LIMIT, linewidth=1, linestyle="--", zorder=1)
        axes.annotate(
            f"{limit:g} {'m' if k == 0 else 'deg'}", (1, limit), (-4, 3), ("axes fraction", "data"), "offset points",
            ha="right", fontsize=8, color=LIMIT,
        )  # fmt: skip
        for at in log.kidnapped_at:
            axes.axvline(at, color=TRUTH, linewidth=1, linestyle=":")
        axes.set_yscale("log")
        axes.set_ylabel(label)
        axes.set_xlim(log.times[0], log.times[-1])
        axes.autoscale(axis="y")
        axes.grid(alpha=0.25, linewidth=0.5)
        axes.spines[["top", "right"]].set_visible(False)
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    if position.get_legend_handles_labels()[0]:
        position.legend(loc="upper right", frameon=False, fontsize=8)
    heading.set_xlabel("time since the first scan (s)" + (", dotted: kidnapped" if log.kidnapped_at else ""))


def _map(axes: Axes, shown: _Shown) -> None:
    log = shown.log
    truth = log.truth[known(log.truth)]
    if log.grid is not None:
        draw_grid(axes, log.grid)
    _lines(axes, [path(run.poses[known(run.truth)]) for run in log.runs], shown)
    axes.plot(*path(truth).T, color=TRUTH, linewidth=1.2, linestyle=(0, (5, 2)), zorder=4)
    for good, colour, marker in ((False, BAD, "X"), (True, GOOD, "o")):
        chosen = [run for run, is_good in zip(log.runs, shown.good, strict=True) if is_good == good]
        ends = np.array([run.poses[known(run.truth)][-1, :2] for run in chosen])
        if len(ends):
            axes.scatter(
                ends[:, 0], ends[:, 1], s=42, c=colour, marker=marker, edgecolors="white", linewidths=0.7, zorder=5
            )
    axes.scatter(truth[0, 0], truth[0, 1], s=110, c="white", marker="s", edgecolors=TRUTH, linewidths=1.5, zorder=6)
    axes.scatter(truth[-1, 0], truth[-1, 1], s=130, c="white", marker="*", edgecolors=TRUTH, linewidths=1.2, zorder=6)
    _frame(axes, log, truth)
    _legend(axes, shown)


def _frame(axes: Axes, log: LogEvaluation, truth: Array) -> None:
    """Show the known part of the map (or the reference alone), not the ocean around it."""
    corners = truth[:, :2]
    if log.grid is not None and log.grid.known.any():
        corners = np.vstack([corners, *log.grid.known_area])
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = 0.02 * float(np.max(high - low)) + 0.5
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)
    axes.set_aspect("equal")
    axes.set_facecolor(str(UNKNOWN))
    axes.locator_params(steps=[1, 2, 5, 10])
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.spines[["top", "right"]].set_visible(False)


def draw_grid(axes: Axes, grid: OccupancyGrid) -> None:
    """The whole map in grey, in metres of the map frame; light enough to see paths on its walls."""
    from matplotlib.transforms import Affine2D

    x, y, yaw = grid.origin
    shade = np.where(
        grid.known, 1.0 - 0.75 * np.nan_to_num(grid.occupancy), UNKNOWN
    )  # grey enough to see paths on walls
    axes.imshow(
        shade, cmap="gray", vmin=0, vmax=1, origin="lower", interpolation="nearest",
        extent=(0.0, grid.width * grid.resolution, 0.0, grid.height * grid.resolution),
        transform=Affine2D().rotate(yaw).translate(x, y) + axes.transData,
    )  # fmt: skip


def _legend(axes: Axes, shown: _Shown) -> None:
    from matplotlib.lines import Line2D

    well = sum(shown.good)
    badly = len(shown.good) - well
    dot: dict[str, Any] = {"linestyle": "none", "markeredgecolor": TRUTH, "markerfacecolor": "white"}
    entries = [
        Line2D([], [], color=TRUTH, linewidth=1.2, linestyle=(0, (5, 2)), label=shown.reference),
        Line2D([], [], marker="s", markersize=7, label="its start", **dot),
        Line2D([], [], marker="*", markersize=12, label="its end", **dot),
    ]
    for runs, colour, marker, does in ((well, GOOD, "o", shown.well), (badly, BAD, "X", shown.badly)):
        if runs:
            entries.append(Line2D([], [], color=colour, marker=marker, markeredgecolor="white", label=f"{runs} {does}"))
    axes.figure.legend(handles=entries, loc="outside lower center", ncols=len(entries), frameon=False)


def _lines(axes: Axes, curves: Sequence[Array], shown: _Shown) -> None:
    """One line per run, those that failed, or ended elsewhere, below the others."""
    from matplotlib.collections import LineCollection

    alpha = float(np.clip(6 / len(curves), 0.12, 0.8))
    for good, colour in ((False, BAD), (True, GOOD)):
        chosen = [curve for curve, is_good in zip(curves, shown.good, strict=True) if is_good == good]
        axes.add_collection(LineCollection(chosen, colors=colour, linewidths=0.9, alpha=alpha, zorder=3))


def _median(axes: Axes, curves: Sequence[Array], shown: _Shown) -> None:
    """The median over the good runs, scan by scan, where there are enough of them to need one."""
    from matplotlib.patheffects import Normal, Stroke

    chosen = [curve for curve, is_good in zip(curves, shown.good, strict=True) if is_good]
    if len(chosen) >= 5 and all(len(curve) == len(chosen[0]) for curve in chosen):
        time, error = chosen[0][:, 0], np.median([curve[:, 1] for curve in chosen], axis=0)
        rim = [Stroke(linewidth=3.2, foreground="white"), Normal()]
        label = f"median of the runs that {shown.well}"
        axes.plot(time, error, color=TRUTH, linewidth=1.4, path_effects=rim, zorder=4, label=label)


def _floored(poses: Array, truth: Array) -> tuple[Array, Array]:
    """Errors in metres and degrees, not below what a logarithmic axis should stretch for."""
    position, heading = pose_errors(poses, truth)
    return np.maximum(position, 0.01), np.maximum(np.degrees(heading), 0.1)


def _thin(n: int) -> slice[Any, Any, Any]:
    return slice(None, None, max(1, -(-n // POINTS)))


def path(poses: Array) -> Array:
    """x and y of poses (n, 3), with a row of NaN wherever the path jumps."""
    points = poses[_thin(len(poses)), :2]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.insert(points, np.flatnonzero(steps > JUMP) + 1, np.nan, axis=0)
