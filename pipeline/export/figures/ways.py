"""Where runs went: one run's path on its map, and several runs on one, with how far they are from the truth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.errors import MclError
from pipeline.export.figures.errors import LEAST, draw_error, position_error
from pipeline.export.figures.ground import (
    DASHED,
    DOTTED,
    SOLID,
    aspect,
    draw_ends,
    draw_map,
    draw_path,
    estimated,
    hindsight_path,
    over_time,
    true_path,
)
from pipeline.export.figures.paper import Paper, rgb
from pipeline.export.run import Run, differing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TALLEST = 1.3
"""A map is drawn no higher than so many times its width."""
DASHES = (SOLID, DASHED, DOTTED, (0, (6.0, 1.2, 1.2, 1.2)), (0, (6.0, 1.2, 1.2, 1.2, 1.2, 1.2)), (0, (2.5, 1.0)))
"""Of runs side by side, in the order of their colours."""
NAMED = 2
"""Parameters that name a run, at most; of more that differ its folder does."""


def path(run: Run, paper: Paper) -> Figure:
    """The path of a run on its map: as it was estimated then, in hindsight, and the truth where it is known."""
    theme, tall = paper.theme, min(aspect(run), TALLEST)
    figure = paper.figure(0.55 + 0.95 * paper.width * tall)
    axes = figure.subplots()
    draw_map(axes, run, paper)
    if (hindsight := hindsight_path(run)) is not None:
        draw_path(axes, hindsight, theme.hindsight, paper, DOTTED, label="in hindsight", zorder=4)
    draw_path(axes, estimated(run), theme.estimate, paper, label="estimate", zorder=3)
    if (truth := true_path(run)) is not None:  # the widest one, below the others: where they lie on it, it shows
        draw_path(axes, truth, theme.truth, paper, label="truth", linewidth=3.0, zorder=2)
    draw_ends(axes, run, paper, theme.estimate)
    paper.legend(figure)
    return figure


def compare(runs: Sequence[Run], paper: Paper) -> Figure:
    """Runs on the map of the first one, and over time how far each is from the truth, else from the first run.

    Raises MclError for one run alone, for more than there are colours, and for runs of different maps.
    """
    if not 2 <= len(runs) <= len(DASHES):
        raise MclError(f"a comparison is of 2 to {len(DASHES)} runs, not of {len(runs)}", "name them one after another")
    if len({run.told.map_sha256 for run in runs}) > 1:
        raise MclError("these runs are on different maps", "compare runs on one map")
    first, theme = runs[0], paper.theme
    shape = aspect(first)
    if paper.wide:
        figure = paper.figure(0.8 + max(0.5 * (paper.width - 1.1) * min(shape, TALLEST), 1.6))
        where, when = figure.subplots(1, 2, width_ratios=(1.0, 0.9))
    else:
        low = 0.45 * paper.width
        tall = paper.width * min(shape, TALLEST)
        figure = paper.figure(0.9 + tall + low)
        where, when = figure.subplots(2, 1, height_ratios=(tall, low))
    draw_map(where, first, paper)
    if (truth := true_path(first)) is not None:
        where.plot(*truth.T, color=rgb(theme.muted), linewidth=3.0, alpha=0.6, label="truth", zorder=2)
    known = [position_error(run) for run in runs]
    against = all(error is not None for error in known)
    for k, (run, label) in enumerate(zip(runs, labels(runs), strict=True)):
        colour, dashes = theme.runs[k], DASHES[k]
        draw_path(where, estimated(run), colour, paper, dashes, label=label, zorder=4 + k)
        error = known[k] if against else _from(first, run)
        if error is not None:
            at, shown = over_time(run, np.maximum(error, LEAST[0]))
            when.plot(at, shown, color=rgb(colour), linestyle=dashes, linewidth=0.9)
    draw_error(when, "position error (m)" if against else f"distance from {labels(runs)[0]} (m)")
    when.set_xlabel("time since the first scan (s)")
    paper.legend(figure)
    return figure


def labels(runs: Sequence[Run]) -> list[str]:
    """What tells the runs apart: log, seed and parameters, or their folders where those are many, or none."""
    told = [[run.name] if len({one.name for one in runs}) > 1 else [] for run in runs]
    seeds, config = {run.seed for run in runs}, differing(runs)
    if len(config) <= NAMED:
        for row, run in zip(told, runs, strict=True):
            row += [f"seed {run.seed}"] if len(seeds) > 1 else []
            row += [f"{key}={run.told.config.get(key)}" for key in config]
        found = [", ".join(row) for row in told]
        if len(set(found)) == len(runs):
            return found
    return [_folder(run.told.path) for run in runs]


def _folder(recording: Path) -> str:
    return recording.resolve().parent.name if recording.stem == "run" else recording.stem


def _from(first: Run, run: Run) -> np.ndarray | None:
    """(n,) m from the first run's estimate at the same stamps, NaN at others; None of the first run itself."""
    if run is first:
        return None
    _, mine, its = np.intersect1d(run.told.stamps, first.told.stamps, return_indices=True)
    distance = np.full(len(run.told.stamps), np.nan)
    distance[mine] = np.hypot(*(run.told.poses[mine, :2] - first.told.poses[its, :2]).T)
    return distance
