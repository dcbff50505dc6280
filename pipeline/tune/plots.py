"""What was learned as a picture: the sensor model over its readings, the laser's drift over its windows."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.tune.drift import DRIFTS, WINDOWS
from pipeline.tune.em import Array
from pipeline.tune.histograms import Plane, Residuals, plane, residuals
from pipeline.tune.learning import Tuning

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Okabe and Ito's palette, told apart by every kind of colour vision.
MEASURED, BEFORE, AFTER = "#BBBBBB", "#D55E00", "#0072B2"
DENSITIES = 1e-3, 10.0


def plot(tuning: Tuning, path: str | Path) -> None:
    """Draw residuals, the plane of measured and true ranges, and the laser's drift into the file ``path``."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(19.5, 5.2), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)  # not pyplot: no display, no state left behind
    left, middle, right, last = figure.subplots(1, 4, width_ratios=(1.3, 1, 1, 0.9))
    _residuals(left, residuals(tuning.readings, tuning.before, tuning.after))
    both = plane(tuning.readings, tuning.after)
    _plane(middle, both, both.measured, "measured")
    picture = _plane(right, both, both.fitted, "fitted")
    figure.colorbar(picture, ax=[middle, right], label="density of z given z* (1/m)", extend="both")
    _drift(last, tuning)
    names = ", ".join(log.name for log in tuning.logs)
    figure.suptitle(f"{names}: {tuning.beams:,} beams of {tuning.scans:,} scans", fontweight="bold")
    figure.savefig(path)


def _residuals(axes: Axes, found: Residuals) -> None:
    axes.fill_between(found.at, found.measured, step="mid", color=MEASURED, label="measured")
    axes.plot(found.at, found.before, color=BEFORE, linestyle=(0, (4, 2)), linewidth=1.4, label="model before")
    axes.plot(found.at, found.after, color=AFTER, linewidth=1.8, label="model after")
    axes.set_yscale("log")
    axes.set_ylim(*DENSITIES)
    axes.set_xlim(found.at[0], found.at[-1])
    axes.set_xlabel("measured less true range, z - z* (m)")
    axes.set_ylabel("density (1/m)")
    axes.grid(alpha=0.25, linewidth=0.5)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)


def _drift(axes: Axes, tuning: Tuning) -> None:
    """How far hindsight and the laser's odometry are apart after a path: medians as deviations, and the fit."""
    turns = axes.twinx()
    rows = tuning.drift.windows
    length = np.argmin(np.abs(np.log(np.maximum(rows[:, :1], 1e-9) / WINDOWS)), axis=1)
    path = np.linspace(0.0, WINDOWS[-1], 100)
    errors = (100.0 * rows[:, 1:3], np.degrees(rows[:, 3:]))
    looks = ((axes, AFTER, "o", 100.0), (turns, BEFORE, "s", np.degrees(1.0)))
    for k, (where, colour, marker, unit) in enumerate(looks):
        for i, far in enumerate(WINDOWS):
            apart = np.abs(errors[k][length == i])
            if np.isfinite(apart).any():
                where.plot(far, np.nanmedian(apart) / 0.6745, marker, color=colour)
        drift = getattr(tuning.after, DRIFTS[k])
        where.plot(path, unit * np.sqrt(tuning.drift.jitter[k] + drift**2 * path), color=colour, linewidth=1.8)
        where.set_ylim(bottom=0.0)
        where.tick_params(axis="y", colors=colour)
        where.spines["top"].set_visible(False)
    axes.set_title("hindsight less laser odometry" if len(rows) else "no laser odometry")
    axes.set_xlabel("path (m)")
    axes.set_ylabel("deviation of the place, along one axis (cm)", color=AFTER)
    turns.set_ylabel("deviation of the heading (degrees)", color=BEFORE)
    axes.grid(alpha=0.25, linewidth=0.5)


def _plane(axes: Axes, found: Plane, density: Array, title: str):  # type: ignore[no-untyped-def]  # untyped library
    from matplotlib.colors import LogNorm

    axes.set_facecolor("0.9")
    picture = axes.imshow(
        np.where(np.isnan(density), np.nan, np.maximum(density, DENSITIES[0])),
        origin="lower", extent=(0, found.reach, 0, found.reach), interpolation="nearest", cmap="viridis",
        norm=LogNorm(*DENSITIES),
    )  # fmt: skip
    axes.set_title(title)
    axes.set_xlabel("true range in the map, z* (m)")
    axes.set_ylabel("measured range, z (m)")
    return picture
