"""A filter that tells where the robot is, whatever it does inside: one of the user's own, or the Kalman filter."""

from __future__ import annotations

import dataclasses
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.filter.estimate import Clusters
from pipeline.filter.particle_filter import ParticleFilter
from pipeline.filter.particles import Particles
from pipeline.filter.recovery import Takeover
from pipeline.filter.sensor import Reading, Sensor
from pipeline.filter.step import Estimate
from pipeline.geometry import wrap_angle
from pipeline.kernels.random import stream_key
from pipeline.logs.messages import Laser, Scan
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.motion.models import Component
from pipeline.motion.prior import Prior
from pipeline.motion.witnesses import Motion
from pipeline.parts.loading import built_in
from pipeline.parts.own import Own
from pipeline.parts.roles import ROLES
from pipeline.world.seen import Seen

Array = NDArray[np.float64]

SHOWN = 1000
"""Particles that stand for a Gaussian in the picture."""
SHOW = 1
"""Purpose of random numbers."""


class Filter(Protocol):
    """What a filter of the user's own must do."""

    def update(self, scan: Scan, step: Component | None) -> tuple[Array, Array]:
        """The belief once the robot has made the ``step`` (None at the first scan) and seen the ``scan``.

        A pose (3,) m, m, rad in the map frame and its covariance (3, 3); or particles (3, n) in the map frame and their
        weights (n,), which need not sum to one.
        """


class ToldBelief:
    """What ``Belief`` is to particles: ``particles`` are drawn from what the filter tells, or are its own."""

    def __init__(self, grid: OccupancyGrid, config: Config, sensor: Sensor, seed: int) -> None:
        self._grid, self._sensor, self._seed = grid, sensor, seed
        self._clusters = Clusters(grid, config.max_particles)
        self.particles = Particles(config.max_particles)
        self.hypotheses: tuple[Estimate, ...] = ()
        self.followed: Array = np.empty(0)

    def gaussian(self, pose: Array, covariance: Array, reading: Reading, scan: int) -> None:
        """The belief is one Gaussian in the map frame."""
        rng = np.random.Generator(np.random.Philox(key=int(stream_key(self._seed, scan, SHOW))))
        values, vectors = np.linalg.eigh(covariance)
        n = min(SHOWN, self.particles.capacity)
        draws = pose[:, None] + vectors @ (np.sqrt(np.maximum(values, 0.0))[:, None] * rng.standard_normal((3, n)))
        self._place(draws, np.full(n, 1.0 / n), reading)
        self.hypotheses = (Estimate(pose, covariance),)

    def weighted(self, poses: Array, weights: Array, reading: Reading) -> None:
        """The belief is these particles (3, n) of the map frame with weights (n,) summing to one."""
        self._place(poses, weights, reading)
        self.hypotheses = self._clusters.find(self.particles.poses, self.particles.weights)

    def _place(self, poses: Array, weights: Array, reading: Reading) -> None:
        p = self.particles
        placed = self._grid.to_grid(poses.T).T
        placed[2] = wrap_angle(placed[2])
        p.place(np.ascontiguousarray(placed.astype(np.float32)))
        self._sensor.score(p.poses, reading, p.log_likelihood)
        p.weights[:], p.log_weights[:] = weights, np.log(np.maximum(weights, 1e-300))
        p.ess = 1.0 / float(np.square(weights).sum())


class ToldFilter(ParticleFilter):
    """Asks another filter where the robot is; witnesses of motion, picture and verdict are those of ``ParticleFilter``.

    There is no search of the building, no memory and no land off the map.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        laser: Laser,
        config: Config,
        seed: int = 0,
        *,
        wheels: bool = True,
        seen: Seen | None = None,  # noqa: ARG002  (it remembers nothing of the world)
    ) -> None:
        alone = {"recovery": "none", "without": (*config.without, "off_map", "memory")}
        config = config.model_copy(update=alone)
        super().__init__(grid, laser, config, seed, wheels=wheels)
        given = {"grid": grid, "laser": laser, "max_range": config.laser_max_range or laser.range_max}
        self._own = config.own_part("filter", **given)
        if self._own is None:
            kind = built_in(ROLES["filter"], config.filter)
            self._update = kind(config=config, **given).update
        else:
            self._update = self._own
        self._told = ToldBelief(grid, config, self._sensor, seed)
        self._belief = self._told  # type: ignore[assignment]

    def _start(self, scan: Scan, reading: Reading) -> None:
        self._ask(scan, None, reading)

    def _advance(self, scan: Scan, reading: Reading, motion: Motion, prior: Prior) -> tuple[bool, Takeover | None]:
        self._ask(dataclasses.replace(scan, ranges=motion.ranges.copy()), together(prior), reading)
        self._told.followed = np.array([component.share for component in prior.components])
        return False, None

    def _ask(self, scan: Scan, step: Component | None, reading: Reading) -> None:
        more: dict[str, Any] = {}
        if self._own is not None:
            more["rng"] = np.random.Generator(np.random.Philox(key=int(stream_key(self._seed, scan.index, SHOW + 1))))
        answer = self._update(scan, step, **more)
        if self._own is None:
            pose, covariance = answer
            self._told.gaussian(pose, covariance, reading, scan.index)
        else:
            self._take(self._own, answer, reading, scan.index)

    def _take(self, own: Own, answer: Any, reading: Reading, scan: int) -> None:
        """What a filter of the user's own tells, once it is known to be a belief."""
        first, second = own.pair(answer, "a pose and its covariance, or particles and their weights")
        shape, most = np.shape(first), self._told.particles.capacity
        if len(shape) == 1:
            self._told.gaussian(own.poses(first, (3,), "a pose"), own.covariance(second), reading, scan)
            return
        if len(shape) != 2 or shape[0] != 3 or not 1 <= shape[1] <= most:
            raise own.wrong(f"it gave particles of {shape}, expected (3, n), with n from 1 to max_particles, {most}")
        poses, weights = own.poses(first, shape, "particles"), own.array(second, shape[1:], "weights")
        if (weights < 0.0).any() or not weights.sum() > 0.0:
            raise own.wrong("it gave weights that are negative, or all zero")
        self._told.weighted(poses, weights / weights.sum(), reading)


def together(prior: Prior) -> Component:
    """The prior as one Gaussian: the components' common mean and covariance."""
    shares = np.array([component.share for component in prior.components])
    shares /= shares.sum()
    steps = np.array([component.step for component in prior.components])
    off = steps - steps[0]
    off[:, 2] = wrap_angle(off[:, 2])
    mean = shares @ off
    around = off - mean
    within = np.einsum("i,ijk->jk", shares, np.array([component.covariance for component in prior.components]))
    return Component("together", steps[0] + mean, within + (around.T * shares) @ around)


def filter_of(config: Config) -> type[ParticleFilter]:
    """The filter that ``config.filter`` names; raises MclError if it cannot be loaded."""
    if config.written("filter") is None:
        kind = built_in(ROLES["filter"], config.filter)
        if issubclass(kind, ParticleFilter):
            return kind
    return ToldFilter
