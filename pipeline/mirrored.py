"""Whether a log's scans are mirrored: then its laser is mounted upside down, and the log does not say so."""

from __future__ import annotations

import dataclasses

import numpy as np

from pipeline.config import Config
from pipeline.localization import localize
from pipeline.logs.messages import Log

SECONDS = 120.0
"""s: of the log, from its start: so much tells, and costs little."""
PLAINLY = 0.15
"""Share of the beams by which the mirrored scans must be explained better."""


def mirrored(log: Log, config: Config, explained: float, seed: int = 0) -> bool:
    """Whether the robot is found better when each scan is read from its last beam to its first.

    ``explained``: share of the beams that the map explains as the log is. Single scans do not tell: a building has
    places that look like the mirrored ones. So the start of the log is localized once more.
    """
    n = int(np.searchsorted(log.times, SECONDS))
    start = log.part(slice(n))
    turned_round = dataclasses.replace(
        start,
        laser=dataclasses.replace(log.laser, angle_min=-float(log.laser.angles[-1])),
        ranges=np.ascontiguousarray(start.ranges[:, ::-1]),
        sweeps=None,
    )
    result = localize(turned_round, config, seed=seed)
    return float(np.mean(result.explained[n // 2 :])) > explained + PLAINLY
