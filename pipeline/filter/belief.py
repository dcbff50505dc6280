"""A belief that lives on its own: particles, the hypotheses among them, and how they are renewed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.filter.adaptive import next_count
from pipeline.filter.estimate import Clusters
from pipeline.filter.motion_model import OdometryMotion
from pipeline.filter.particles import Particles
from pipeline.filter.resampling import draw_ancestors
from pipeline.filter.sensor import Reading, Sensor
from pipeline.filter.step import Estimate
from pipeline.kernels.random import stream_key
from pipeline.maps.occupancy_grid import OccupancyGrid

PATCH_D = 1.0
PATCH_A = 1.0
"""m, rad of driving in which the map counts once: where it is wrong, it is wrong for all the scans taken there."""
SETTLED = 0.9
"""Weight of the best hypothesis from which on a belief is settled."""
MOTION, RESAMPLE = 1, 2
"""Purposes of random numbers; a belief adds its own ``stream``, so that no two beliefs share any."""


def patches(motion: OdometryMotion) -> float:
    """How much of a new patch of floor a move leads to, at most one."""
    return min(1.0, abs(motion.trans) / PATCH_D + abs(motion.rot1 + motion.rot2) / PATCH_A)


class Belief:
    """Predict, weigh, group, resample: one turn of Table 8.2 for each scan.

    ``stream`` tells the random numbers of this belief from those of others of the same seed; ``settled``: whether it
    follows every scan from the start.
    """

    def __init__(
        self, grid: OccupancyGrid, config: Config, sensor: Sensor, seed: int, stream: int, settled: bool
    ) -> None:
        self._config, self._sensor, self._seed, self._stream = config, sensor, seed, stream
        self._clusters = Clusters(grid, config.max_particles)
        self._resample_due = False
        self.particles = Particles(config.max_particles)
        self.hypotheses: tuple[Estimate, ...] = ()
        self.settled = settled

    def resample(self, scan: int) -> bool:
        """Survivors replace the particles, if the weights have become uneven; returns whether they did.

        Done before the next scan, so that a step shows the weights that chose the survivors.
        """
        if not self._resample_due:
            return False
        p = self.particles
        n = next_count(p.n, p.weights, self._clusters.bin_weights, self._config)
        key = stream_key(self._seed, scan, self._stream + RESAMPLE)
        p.survive(draw_ancestors(p.weights, n, self._config.resampler, key))
        self._resample_due = False
        return True

    def predict(self, motion: OdometryMotion, scan: int) -> None:
        """Every particle drives as the odometry says, each with noise of its own (Table 5.6)."""
        self.particles.predict(motion, stream_key(self._seed, scan, self._stream + MOTION))

    def weigh(self, reading: Reading, temper: float) -> float:
        """Every particle is weighed by how well its pose explains the scan; returns the log-evidence of the scan."""
        p, least = self.particles, self._config.resample_ess
        self._sensor.score(p.poses, reading, p.log_likelihood)
        evidence = p.weigh(temper)
        self._resample_due = p.ess < least * p.n or least == 1.0
        self.hypotheses = self._clusters.find(p.poses, p.weights)
        return evidence

    def caution(self, motion: OdometryMotion) -> float:
        """Exponent on a scan's likelihood: a belief that has not settled counts each patch of floor once.

        So places that look alike live side by side until a difference is driven past; a belief that has settled follows
        every scan. Once settled it stays so: being wrong is for the recovery to find out.
        """
        self.settled = self.settled or self.hypotheses[0].weight > SETTLED
        return 1.0 if self.settled else patches(motion)

    def admit(self, poses: NDArray[np.float32], share: float, key: np.uint64) -> None:
        """Newcomers (3, m) join with this share of the weight between them, making room if need be."""
        p = self.particles
        room = p.capacity - poses.shape[1]
        if p.n > room:
            p.survive(draw_ancestors(p.weights, room, "low_variance", key))
        p.admit(poses, share)
        self.hypotheses = self._clusters.find(p.poses, p.weights)
