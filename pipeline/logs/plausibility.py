"""Whether a truth can be that of its log: before hours of runs are scored against it."""

from __future__ import annotations

import numpy as np

from pipeline.logs.messages import Log

ENOUGH = 0.5
"""Share of scans with a truth, and of the truth on the map, below which something is wrong."""


def doubt_truth(log: Log) -> str:
    """One line that says what is wrong with the log's ground truth; empty if nothing is, or if it has none.

    It must overlap the scans in time, and, where there is a map, lie where the map knows the floor.
    """
    truth = log.ground_truth
    if truth is None or len(truth.stamps) == 0 or len(log) == 0:
        return ""
    first, last = truth.stamps[0], truth.stamps[-1]
    covered = float(np.mean((log.stamps >= first) & (log.stamps <= last)))
    if covered < ENOUGH:
        spans = f"it runs from {_seconds(first)} to {_seconds(last)}, the scans from {_seconds(log.stamps[0])} to "
        return f"the truth covers {100 * covered:.0f} % of the scans: {spans}{_seconds(log.stamps[-1])}"
    if log.grid is None:
        return ""
    cells = np.floor(log.grid.to_grid(truth.poses)[:, :2] / log.grid.resolution)
    inside = ((cells >= 0) & (cells < [log.grid.width, log.grid.height])).all(axis=1)
    col, row = cells[inside].astype(np.int64).T
    on_map = float(np.count_nonzero(log.grid.known[row, col])) / len(cells)
    if on_map < ENOUGH:
        low, high = truth.poses[:, :2].min(axis=0), truth.poses[:, :2].max(axis=0)
        area = f"x {low[0]:.1f} to {high[0]:.1f} m, y {low[1]:.1f} to {high[1]:.1f} m"
        share = f"{100 * on_map:.0f} % of the truth"
        return f"{share} ({area}) lies where the map knows anything: is it in the map's frame?"
    return ""


def _seconds(stamp: int) -> str:
    return f"{stamp / 1e9:.3f} s"
