"""What figures of the map share: the map as an image, metres along its sides, a scale bar, paths, poses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.export.figures.paper import Paper, rgb
from pipeline.export.run import Run
from pipeline.maps.occupancy_grid import part_that_is_known
from pipeline.recording import palette
from pipeline.recording.gaps import longest_interval
from pipeline.recording.palette import Colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

FINEST = 1200
"""Pixels along a side of the map's image: more than a column shows on paper."""
SOLID, DASHED, DOTTED = "-", (0, (4.0, 1.6)), (0, (1.0, 1.0))
"""Paths differ in their dashes too: on a black-and-white printer colours do not."""


def draw_map(axes: Axes, run: Run, paper: Paper, area: tuple[Array, Array] | None = None) -> None:
    """The map, from the lowest to the highest (x, y) of ``area``, else what it knows; a scale bar; metres."""
    from matplotlib.transforms import Affine2D

    grid, theme = run.scenes.grid, paper.theme
    rows, columns = part_that_is_known(grid.known.astype(np.uint8), np.array([False, True]))
    shades = run.scenes.shades[rows, columns]
    known = shades != palette.UNKNOWN[0]
    step = max(1, -(-max(shades.shape) // FINEST))
    # Of cells that share a pixel the most occupied one stays: walls are thin.
    shades = _coarser(np.where(known, shades, 255), step)
    known = -_coarser(-known.astype(np.int64), step) > 0
    image = np.where(known, theme.tones[shades], np.uint8(theme.around))
    x, y, yaw = grid.origin
    resolution = grid.resolution
    left, bottom = columns.start * resolution, rows.start * resolution
    extent = (left, left + image.shape[1] * step * resolution, bottom, bottom + image.shape[0] * step * resolution)
    axes.imshow(
        np.repeat(image[:, :, None], 3, axis=2), origin="lower", extent=extent,
        interpolation="none" if paper.exact else "antialiased",
        transform=Affine2D().rotate(yaw).translate(x, y) + axes.transData,
    )  # fmt: skip
    low, high = area or run.area
    axes.set_facecolor((theme.around / 255,) * 3)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.locator_params(steps=[1, 2, 5, 10], nbins=6)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    _scale_bar(axes, paper, float(high[0] - low[0]))


def draw_path(axes: Axes, places: Array, colour: Colour, paper: Paper, dashes: Any = SOLID, **more: Any) -> None:
    """A line through places (n, 2), broken by NaN, with a rim that lifts it off the walls."""
    from matplotlib.patheffects import Normal, Stroke

    width = more.pop("linewidth", 1.1)
    rim = [Stroke(linewidth=width + 0.9, foreground=rgb(paper.theme.ground)), Normal()] if dashes == SOLID else None
    axes.plot(*places.T[:2], color=rgb(colour), linestyle=dashes, linewidth=width, path_effects=rim, **more)


def draw_ends(axes: Axes, run: Run, paper: Paper, colour: Colour) -> None:
    """A square where the run's estimate is when it is first sure, or at its end, and a disc where it ends."""
    told = run.told
    first = 0 if told.converged_at is None else run.scenes.row_at(told.converged_at)
    ink, ground = rgb(paper.theme.ink), rgb(paper.theme.ground)
    marks: dict[str, Any] = {
        "linestyle": "none",
        "markeredgecolor": ink,
        "zorder": 6,
        "markersize": 4.5,
        "markeredgewidth": 0.8,
    }
    if told.converged_at is not None:
        axes.plot(*told.poses[first, :2], marker="s", markerfacecolor=ground, label="converged", **marks)
    axes.plot(*told.poses[-1, :2], marker="o", markerfacecolor=rgb(colour), label="end", **marks)


def estimated(run: Run) -> Array:
    """(n, 2) the estimate's path, with a NaN where it jumps."""
    return np.insert(run.told.poses[:, :2], np.flatnonzero(~run.scenes.joined[1:]) + 1, np.nan, axis=0)


def true_path(run: Run) -> Array | None:
    """(n, 2) the truth's, with a NaN where somebody carried the robot; None if nobody knows it."""
    places = run.scenes.truth[:, :2]
    if np.isnan(places).all():
        return None
    return np.insert(places, np.flatnonzero(np.hypot(*np.diff(places, axis=0).T) > 1.0) + 1, np.nan, axis=0)


def hindsight_path(run: Run) -> Array | None:
    """(n, 2) the path as known in hindsight, a NaN between its pieces; None if the run has none."""
    pieces = [run.scenes.hindsight[k] for k in range(len(run.scenes.hindsight))]
    return np.concatenate([part for piece in pieces for part in (piece, [[np.nan] * 2])]) if pieces else None


def over_time(run: Run, values: Array) -> tuple[Array, Array]:
    """Times (s) and values, with a NaN where there are no scans: nothing is known of what was between."""
    times = run.scenes.times
    gaps = np.flatnonzero(np.diff(times) > longest_interval(times)) + 1
    return np.insert(times, gaps, times[gaps - 1] if len(gaps) else []), np.insert(values, gaps, np.nan)


def aspect(run: Run) -> float:
    """Height of what the map knows over its width."""
    low, high = run.area
    return float((high[1] - low[1]) / (high[0] - low[0]))


def _coarser(values: NDArray[Any], step: int) -> NDArray[Any]:
    """The least of every step x step cells."""
    if step == 1:
        return values
    high, wide = (-(-side // step) * step for side in values.shape)
    padded = np.full((high, wide), values.max(), values.dtype)
    padded[: values.shape[0], : values.shape[1]] = values
    return padded.reshape(high // step, step, wide // step, step).min(axis=(1, 3))


def _scale_bar(axes: Axes, paper: Paper, across: float) -> None:
    """On the right above the map, where it hides nothing."""
    from matplotlib.font_manager import FontProperties
    from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

    wanted = 0.2 * across
    decade = 10.0 ** np.floor(np.log10(wanted))
    metres = max(k * decade for k in (1, 2, 5) if k * decade <= wanted)
    bar = AnchoredSizeBar(
        axes.transData, metres, f"{metres:g} m", "lower right", pad=0.0, borderpad=0.2, sep=1.5, frameon=False,
        label_top=True, color=rgb(paper.theme.ink), size_vertical=across / 250, bbox_to_anchor=(1.0, 1.0),
        bbox_transform=axes.transAxes, fontproperties=FontProperties(family="DejaVu Sans", size=7.0),
    )  # fmt: skip
    axes.add_artist(bar)
    axes.set_title(" ", loc="right")  # the layout keeps room for titles, not for what is anchored to axes
