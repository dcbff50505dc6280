"""The drift of the laser's own odometry, from how a found trajectory differs from it over windows of its path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.geometry import wrap_angle
from pipeline.tune.em import Array
from pipeline.tune.motion import variances
from pipeline.tune.way import Way

DRIFTS = ("laser_drift_d", "laser_drift_a")
WINDOWS = (2.0, 4.0, 8.0, 16.0)
"""m of path: what grows is told from what does not. Half of each window is the next one's too. Hindsight errs by some
centimetres that last for metres, which over shorter windows look like drift."""
SMALLEST = (0.002, 0.0005)
"""m and rad after one metre: less than hindsight can tell, and a filter that is surer is lost in a map drawn wrong."""
FEWEST = 40
"""Windows, some 20 m of driving, below which the drift is left as it was."""


@dataclass(frozen=True)
class DriftFit:
    """The learned configuration, and what it was learned from.

    ``windows`` (w, 4): as ``drift_windows`` has them. ``jitter``: variance of the place along one axis, m^2, and of the
    heading, rad^2, that does not grow with the path; NaN where nothing was learned.
    """

    config: Config
    windows: Array
    jitter: tuple[float, float]


def drift_windows(way: Way, poses: Array, updates: NDArray[np.int64], scans: NDArray[np.int64]) -> Array:
    """How a trajectory (n, 3) of the map frame differs from the laser's odometry over windows of its updates.

    ``updates`` (m,): all of the filter; ``scans`` (k,): those of them that are trusted. Windows lie within one stretch
    and leave out no update. Returns (w, 4): path as the motion prior counts it, m; error along the map's two axes, m,
    NaN where a match on the way left a direction open; error of heading, rad.

    Every step of the laser is laid out by the heading that the trajectory has meanwhile, so that an error of the
    heading at the start, or its drift on the way, does not count as one of the place.
    """
    if way.laser is None or len(scans) < 2:
        return np.empty((0, 4))
    laser, found = way.laser[scans], poses[scans]
    offset = np.unwrap(found[:, 2] - laser[:, 2])
    middle, steps = 0.5 * (offset[:-1] + offset[1:]), np.diff(laser[:, :2], axis=0)
    cos, sin = np.cos(middle)[:, None], np.sin(middle)[:, None]
    laid = cos * steps + sin * np.column_stack([-steps[:, 1], steps[:, 0]])
    apart = found[:, :2] - _added(laid)
    path = _added(np.hypot(*steps.T) + 0.5 * np.abs(wrap_angle(np.diff(laser[:, 2]))))
    broken = (np.diff(np.searchsorted(updates, scans)) != 1) | (np.diff(way.stretch[scans]) != 0)
    piece, opened = _added(broken), np.cumsum(way.open)
    rows = []
    for far in WINDOWS:
        begin = np.unique(np.searchsorted(path, np.arange(0.0, path[-1], far / 2)))
        end = np.searchsorted(path, path[begin] + far)
        begin, end = begin[end < len(path)], end[end < len(path)]
        begin, end = begin[piece[begin] == piece[end]], end[piece[begin] == piece[end]]
        place = apart[end] - apart[begin]
        place[opened[scans[end]] - opened[scans[begin]] + way.open[scans[begin]] > 0] = np.nan
        rows.append(np.column_stack([path[end] - path[begin], place, wrap_angle(offset[end] - offset[begin])]))
    return np.concatenate(rows)


def fit_drift(found: Sequence[Array], config: Config) -> DriftFit:
    """laser_drift_d and laser_drift_a by non-negative least squares of the squared errors in the logs' windows.

    A constant is fitted beside each, the trajectory's own jitter and the white noise of the matches. What fewer than 40
    windows speak of is left as it was, and nothing is below its SMALLEST.
    """
    rows = np.concatenate([np.empty((0, 4)), *found])
    path, heading = rows[:, :1], rows[:, 3]
    held = ~np.isnan(rows[:, 1])
    errors = np.concatenate([rows[held, 1], rows[held, 2]]), heading
    paths = np.concatenate([path[held], path[held]]), path
    learned, jitter = {}, [np.nan, np.nan]
    for k, windows in enumerate((int(held.sum()), len(rows))):
        if windows >= FEWEST:
            growth, jitter[k] = variances(errors[k], paths[k]).tolist()
            learned[DRIFTS[k]] = max(float(np.sqrt(growth)), SMALLEST[k])
    return DriftFit(config.model_copy(update=learned), rows, (jitter[0], jitter[1]))


def _added(steps: NDArray[np.generic]) -> Array:
    """(n, ...) sums of what was before each of n places, of the n - 1 steps between them."""
    sums = np.cumsum(steps, axis=0, dtype=np.float64)
    return np.concatenate([np.zeros((1, *sums.shape[1:])), sums])
