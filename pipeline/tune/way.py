"""How the robot moved while it was localized, kept from the run: the witnesses' word at every scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.filter.step import Step
from pipeline.motion.witnesses import Motion
from pipeline.tune.em import Array


@dataclass(frozen=True)
class Way:
    """What was known of the motion at the n scans of a log, nothing having looked ahead.

    ``poses`` (n, 3) m, m, rad: dead reckoning by all who were heard; ``wheels``: whether the wheels were among them.
    ``laser`` (n, 3): the laser's own odometry, None if it was not heard; ``stretch`` (n,) int64 counts its breaks;
    ``open`` (n,) bool: its match left a direction open. ``ranges`` (n, beams) float32 m: the scans as the filter saw
    them, the robot's motion taken out.
    """

    poses: Array
    wheels: bool
    laser: Array | None
    stretch: NDArray[np.int64]
    open: NDArray[np.bool_]
    ranges: NDArray[np.float32]


class Listener:
    """A sink that keeps what the witnesses of motion say."""

    def __init__(self) -> None:
        self._motions: list[Motion] = []

    def log(self, step: Step) -> None:
        """Keep the motion of a step."""
        self._motions.append(step.motion)

    @property
    def way(self) -> Way:
        """All that was kept, in columns."""
        motions = self._motions
        matches = [motion.laser for motion in motions if motion.laser is not None]
        return Way(
            poses=np.array([motion.pose for motion in motions]),
            wheels=all(motion.odometry is not None for motion in motions),
            laser=np.array([match.pose for match in matches]) if len(matches) == len(motions) else None,
            stretch=np.array([match.stretch for match in matches], np.int64),
            open=np.array([match.open is not None for match in matches], np.bool_),
            ranges=np.array([motion.ranges for motion in motions], np.float32),
        )
