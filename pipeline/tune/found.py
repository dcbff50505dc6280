"""A log in which the robot was found, and what of it teaches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.logs.messages import Log
from pipeline.tune.em import Array, Readings
from pipeline.tune.scans import evidence, readings
from pipeline.tune.way import Way


@dataclass(frozen=True)
class Found:
    """A log, its scans as the filter saw them, and where hindsight saw the robot.

    ``way``: what the witnesses of motion said; ``trajectory`` (n, 3) in the map frame, at every scan; ``updates`` (m,):
    the scans at which the filter updated its belief; ``scans`` (k,): those of them that are trusted.
    """

    log: Log
    way: Way
    trajectory: Array
    updates: NDArray[np.int64]
    scans: NDArray[np.int64]

    def every(self, most: int) -> NDArray[np.int64]:
        """At most so many of the scans, spread evenly."""
        return self.scans[:: -(-len(self.scans) // most)]

    def readings(self, scans: NDArray[np.int64], config: Config) -> Readings:
        """What these scans measured, and what the map says under this configuration."""
        return readings(self.log, self.trajectory[scans], scans, config)

    def evidence(self, scans: NDArray[np.int64], config: Config, temper: float) -> Array:
        """Nats per scan."""
        return evidence(self.log, self.trajectory[scans], scans, config, temper)
