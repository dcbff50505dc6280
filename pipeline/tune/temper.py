"""How many independent beams a scan counts as: the temper under which the model is right as often as it says."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.logs.messages import Log
from pipeline.tune.em import Array
from pipeline.tune.scans import displaced

WINDOW = 0.2
"""m driven: over so far the beams of one scan after the other are added up before the model must choose a place."""
RIVALS: Array = np.array(
    [(0.0, 0.0, 0.0)]
    + [(x, 0.0, 0.0) for x in (-2.0, -1.0, -0.5, 0.5, 1.0, 2.0)]
    + [(0.0, y, 0.0) for y in (-1.0, -0.5, 0.5, 1.0)]
    + [(0.0, 0.0, turn) for turn in (-0.3, -0.15, 0.15, 0.3, math.pi)]
)
"""The pose that hindsight found, and places that it could have been taken for: m ahead, m to the left, rad."""
FEWEST, MOST = 1.0, 10.0
"""Real logs give 1 to 10. In a simulated one all beams may err on their own: the filter that believes that they do is
sure of one of many places that look alike before it has seen what tells them apart."""


def window_likelihoods(log: Log, way: Array, poses: Array, scans: NDArray[np.int64], config: Config) -> Array:
    """(windows, rivals) log-likelihood of all beams of each window, untempered; the true place is column 0.

    ``way`` (n, 3): dead reckoning at every scan; ``poses`` (k, 3) at the updates ``scans`` (k,): all, since it is
    their number that makes a filter too sure.
    """
    path = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way[:, :2], axis=0).T))])[scans]
    scores = displaced(log, poses, scans, config, RIVALS)
    _, first = np.unique((path / WINDOW).astype(int), return_index=True)
    return np.add.reduceat(scores, first, axis=1).T


def independent_beams(windows: Sequence[Array], beams: int) -> float:
    """Where the mean log-probability of the true place among its rivals is greatest: temperature scaling.

    ``windows``: per log (w, rivals). A scan of ``beams`` beams is tempered by independent_beams / beams. If beams
    erred independently of their neighbours and of the scan before, the answer would be their number.
    """
    from scipy.optimize import minimize_scalar

    scores = np.concatenate(list(windows))

    def loss(log_n: float) -> float:
        tempered = scores * (math.exp(log_n) / beams)
        return float(np.mean(np.logaddexp.reduce(tempered, axis=1) - tempered[:, 0]))

    most = min(MOST, float(beams))
    found = minimize_scalar(loss, bounds=(math.log(min(FEWEST, most / 2)), math.log(most)), method="bounded")
    return math.exp(float(found.x))
