"""A belief that lives on its own: particles, the hypotheses among them, and how they are renewed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.filter.adaptive import next_count
from pipeline.filter.estimate import Clusters
from pipeline.filter.particles import Particles
from pipeline.filter.resampling import low_variance, resampler, teeth
from pipeline.filter.sensor import Reading, Sensor
from pipeline.filter.step import Estimate
from pipeline.filter.substeps import SubSteps
from pipeline.kernels.random import stream_key
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.motion.mover import Mover
from pipeline.motion.prior import Prior

MOTION, RESAMPLE = 1, 2
"""Purposes of random numbers."""


class Belief:
    """Resample, predict, weigh, group: one turn of Table 8.2 for each scan."""

    def __init__(self, grid: OccupancyGrid, config: Config, sensor: Sensor, seed: int) -> None:
        self._config, self._sensor, self._seed = config, sensor, seed
        self._clusters = Clusters(grid, config.max_particles)
        self._resample_due = False
        self._updates = 0
        self._mover, self._draw = Mover(), resampler(config)
        self.particles = Particles(config.max_particles)
        self.hypotheses: tuple[Estimate, ...] = ()
        self.followed: NDArray[np.float64] = np.empty(0)
        self.watcher: SubSteps | None = None

    def resample(self, scan: int, most: bool = False) -> bool:
        """Survivors replace the particles, if the weights have become uneven; returns whether they did.

        Done before the next scan, so that a step shows the weights that chose the survivors. ``most``: in any case, and
        as many as there may be, since the robot may have gone far.
        """
        if not (self._resample_due or most):
            return False
        p, config = self.particles, self._config
        n = config.max_particles if most else next_count(p.n, p.weights, self._clusters.bin_weights, config)
        key = stream_key(self._seed, scan, RESAMPLE)
        ancestors = self._draw(p.weights, n, key)
        if self.watcher is not None:
            self.watcher.resampled(scan, p, self.hypotheses[0], ancestors, teeth(self._draw, n, key))
        p.survive(ancestors)
        self._resample_due = False
        return True

    def advance(self, prior: Prior, reading: Reading, scan: int) -> float:
        """Every particle moves as one of the witnesses says, with noise of its own, and is weighed.

        Returns the logarithm of the mean of the scan's tempered likelihood over the particles.
        """
        key = stream_key(self._seed, scan, MOTION)
        before = self.particles.poses.copy()
        self._mover.move(self.particles.poses, prior, key)
        if self.watcher is not None:
            self.watcher.predicted(scan, before, self.particles, self.hypotheses[0])
        evidence = self.weigh(reading, before)
        if self.watcher is not None:
            self.watcher.weighed(scan, self.particles, self.hypotheses[0])
        self.followed = self._mover.followed(self.particles.weights, prior, key)
        return evidence

    def weigh(self, reading: Reading, before: NDArray[np.float32] | None = None) -> float:
        """Every particle is weighed by how well its pose explains the scan; returns the scan's log-evidence.

        ``before`` (3, n): where the particles came from, if they moved.
        """
        p, least = self.particles, self._config.resample_ess
        self._sensor.score(p.poses, reading, p.log_likelihood, before)
        evidence = p.weigh(reading.temper)
        self._updates += 1
        asked = self._updates % self._config.resample_interval == 0
        self._resample_due = asked and (p.ess < least * p.n or least == 1.0)
        self.hypotheses = self._clusters.find(p.poses, p.weights)
        return evidence

    def move(self, poses: NDArray[np.float32], weights: NDArray[np.float64], key: np.uint64) -> None:
        """Start anew at the place of these poses (3, m), grid frame, with weights (m,) summing to one."""
        p = self.particles
        n = min(p.capacity, max(self._config.min_particles, len(weights)))
        p.place(np.ascontiguousarray(poses[:, low_variance(weights, n, key)]))
        self._resample_due = False
        self.hypotheses = self._clusters.find(p.poses, p.weights)

    def admit(self, poses: NDArray[np.float32], share: float, key: np.uint64) -> None:
        """Newcomers (3, m) join with this share of the weight between them, making room if need be."""
        p = self.particles
        room = p.capacity - poses.shape[1]
        if p.n > room:
            p.survive(low_variance(p.weights, room, key))
        p.admit(poses, share)
        self.hypotheses = self._clusters.find(p.poses, p.weights)
