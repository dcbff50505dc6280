"""Pictures for scripts and notebooks, on matplotlib's axes: a map, a belief on it, the way of a whole run.

Each draws on the axes that it is given, or on new ones, and returns them; what they show is in metres of the map frame.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.evaluate.plots import draw_grid, path
from pipeline.filter.step import Step
from pipeline.localization import RunResult
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.recording import palette

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pipeline.filter.step import Beams

MARGIN = 1.0
"""m shown around what the map knows."""


def draw_map(grid: OccupancyGrid, axes: Axes | None = None) -> Axes:
    """Draw the part of a map that says anything: dark where it is occupied, grey where nothing is known."""
    axes = _axes(axes)
    draw_grid(axes, grid)
    low, high = grid.known_area
    axes.set_xlim(low[0] - MARGIN, high[0] + MARGIN)
    axes.set_ylim(low[1] - MARGIN, high[1] + MARGIN)
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    return axes


def draw_belief(step: Step, grid: OccupancyGrid, axes: Axes | None = None) -> Axes:
    """Draw what a step believes: its particles, darker the heavier; its beams at the estimate; the estimate itself.

    Beams are blue where they end as the map says, vermilion where they end before that, black where they go on.
    """
    axes = draw_map(grid, axes)
    _beams(axes, step.beams)
    x, y, _ = step.particles.T
    heavy = step.weights / max(float(step.weights.max()), 1e-300)
    order = np.argsort(heavy, kind="stable")
    axes.scatter(x[order], y[order], s=4, c=1.0 - heavy[order], cmap="viridis", vmin=0.0, vmax=1.0, zorder=4)
    x0, y0, yaw = step.estimate.pose
    colour = _share(palette.ESTIMATE)
    axes.quiver(x0, y0, np.cos(yaw), np.sin(yaw), color=colour, scale=20.0, width=0.006, zorder=5)
    axes.scatter([x0], [y0], s=60, facecolors="none", edgecolors=[colour], linewidths=2, zorder=5)
    verdict = f"{step.verdict.kind} with probability {step.verdict.probability:.2f}"
    axes.set_title(f"{step.time:.1f} s: {len(step.particles):,} particles, {verdict}")
    return axes


def draw_run(result: RunResult, axes: Axes | None = None) -> Axes:
    """Draw the way of a run on its map: as estimated then, in hindsight, and the truth where the log knows it."""
    if (grid := result.log.grid) is None:
        raise MclError("the log has no map", path=result.log.path)
    axes = draw_map(grid, axes)
    truth = result.log.ground_truth
    ways = [
        ("truth", None if truth is None else truth.poses, palette.TRUTH),
        ("in hindsight", result.hindsight, palette.HINDSIGHT),
        ("estimate", result.poses, palette.ESTIMATE),
    ]
    for name, poses, colour in ways:
        if poses is not None:
            axes.plot(*path(poses).T, color=_share(colour), linewidth=1.4, label=name)
    axes.legend(loc="best", frameon=False)
    axes.set_title(f"{result.log.name}, seed {result.seed}")
    return axes


def _axes(axes: Axes | None) -> Axes:
    if axes is not None:
        return axes
    from matplotlib import pyplot as plt  # only here: it keeps what it made, for notebooks and plt.show()

    return plt.subplots(figsize=(8.0, 6.0), layout="constrained")[1]


def _beams(axes: Axes, beams: Beams) -> None:
    from pipeline.filter.sensor import EXPLAINED_WITHIN as WITHIN  # it loads numba

    x, y, _ = beams.laser
    ends = _ends(beams)
    difference = beams.measured - beams.expected
    kinds = {
        palette.HIT: np.abs(difference) <= WITHIN,
        palette.SHORT: difference < -WITHIN,
        palette.LONG: difference > WITHIN,
    }
    for colour, chosen in kinds.items():
        shown = ends[chosen & np.isfinite(ends).all(axis=1)]
        rays = np.full((3 * len(shown), 2), np.nan)
        rays[0::3], rays[1::3] = (x, y), shown
        axes.plot(*rays.T, color=_share(colour), linewidth=0.6, alpha=0.6, zorder=3)


def _ends(beams: Beams) -> NDArray[np.float64]:
    """(k, 2) where the beams ended, m in the map frame."""
    x, y, yaw = beams.laser
    reach, angles = beams.measured.astype(np.float64), yaw + beams.angles
    return np.stack([x + reach * np.cos(angles), y + reach * np.sin(angles)], axis=1)


def _share(colour: tuple[int, int, int]) -> tuple[float, float, float]:
    red, green, blue = colour
    return red / 255, green / 255, blue / 255
