"""The parts of a filter's turn, one by one: predict, weigh, resample; for whoever wants to look at them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.filter.step import Estimate

if TYPE_CHECKING:  # whoever only reads sub-steps must not wait for numba
    from pipeline.filter.particles import Particles
    from pipeline.logs.messages import Log
    from pipeline.maps.occupancy_grid import OccupancyGrid

Kind = Literal["predict", "weigh", "resample"]


@dataclass(frozen=True)
class SubStep:
    """One part of the turn that scan ``scan`` brings, ``time`` s after the first scan. Its arrays may be kept.

    ``poses`` (n, 3) float32: x, y, yaw in the map frame; ``weights`` (n,) float64, summing to one. After predicting:
    where the particles have moved to, with the weights that they brought along, and ``before`` (n, 3) where they came
    from. After weighing: with their new weights. In a resampling: those that are drawn from, ``ancestors`` (m,) int32,
    the indices of those that survive, as often as they do, and ``teeth`` (m,) float64, ascending in [0, 1), the places
    on the cumulative weights that chose them; None where the resampler has none.
    ``estimate``: a Gaussian summary of the latest weighing, None before the first one. ``cells``: the poses are the
    centres of cells, which do not move, and the weights their probabilities.
    """

    kind: Kind
    scan: int
    time: float
    poses: NDArray[np.float32]
    weights: NDArray[np.float64]
    before: NDArray[np.float32] | None = None
    ancestors: NDArray[np.int32] | None = None
    teeth: NDArray[np.float64] | None = None
    estimate: Estimate | None = None
    cells: bool = False


class SubSteps:
    """Tells ``tell`` of every sub-step between two moments of a log; a belief calls it on the way."""

    def __init__(self, log: Log, first: float, last: float, tell: Callable[[SubStep], None]) -> None:
        assert log.grid is not None
        self._grid: OccupancyGrid = log.grid
        self._times, self._first, self._last, self._tell = log.times, first, last, tell

    def predicted(self, scan: int, before: NDArray[np.float32], particles: Particles, estimate: Estimate) -> None:
        """The particles have moved; ``before`` (3, n) float32, grid frame, is where they were."""
        if self._wanted(scan):
            self._say("predict", scan, particles, estimate, before=self._in_map(before))

    def weighed(self, scan: int, particles: Particles, estimate: Estimate) -> None:
        """The particles have new weights; ``estimate``: the heaviest hypothesis among them."""
        if self._wanted(scan):
            self._say("weigh", scan, particles, estimate)

    def resampled(
        self,
        scan: int,
        particles: Particles,
        estimate: Estimate,
        ancestors: NDArray[np.int32],
        teeth: NDArray[np.float64] | None,
    ) -> None:
        """These particles (m,) of those that there are survive, chosen by ``teeth`` (m,)."""
        if self._wanted(scan):
            self._say("resample", scan, particles, estimate, ancestors=ancestors.copy(), teeth=teeth)

    def _wanted(self, scan: int) -> bool:
        return bool(self._first <= self._times[scan] <= self._last)

    def _say(
        self,
        kind: Kind,
        scan: int,
        particles: Particles,
        estimate: Estimate,
        *,
        before: NDArray[np.float32] | None = None,
        ancestors: NDArray[np.int32] | None = None,
        teeth: NDArray[np.float64] | None = None,
    ) -> None:
        poses, weights = self._in_map(particles.poses), particles.weights.copy()
        time = float(self._times[scan])
        self._tell(SubStep(kind, scan, time, poses, weights, before, ancestors, teeth, estimate))

    def _in_map(self, poses: NDArray[np.float32]) -> NDArray[np.float32]:
        return self._grid.to_map(poses.T.astype(np.float64)).astype(np.float32)
