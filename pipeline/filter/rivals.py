"""Places where the robot might be instead: each is followed on its own until the evidence has decided."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.filter.resampling import low_variance
from pipeline.filter.sensor import Reading, Sensor
from pipeline.geometry import wrap_angle
from pipeline.kernels import places
from pipeline.kernels.random import stream_key
from pipeline.motion.mover import Mover
from pipeline.motion.prior import Prior

EACH = 300
"""Particles of one rival: enough to follow a single place."""
LEAST_ESS = 0.5
APART_D, APART_A = 1.0, math.radians(30.0)
"""m, rad: closer than this in both, two places are one."""


class Rivals:
    """Small filters (Table 8.2), side by side, one for each place.

    ``poses`` (m, 3) float64 where they are, in the grid frame; ``began`` (m,) seconds, since when they are followed;
    ``margin`` (m,) nats, by which they must stand out to take the belief's place; ``roams`` (m,) whether they may leave
    the map, as a belief may: of places that a search found, which are many, none does;
    ``particles`` (3, m, EACH) float32 and ``weights`` (m, EACH) float64, each row summing to one. ``stream`` is the
    first of three purposes of random numbers.
    """

    def __init__(self, sensor: Sensor, seed: int, stream: int) -> None:
        self._sensor, self._seed, self._stream = sensor, seed, stream
        self._mover = Mover()
        self.particles = np.empty((3, 0, EACH), np.float32)
        self.weights = np.empty((0, EACH))
        self.poses = np.empty((0, 3))
        self.began = np.empty(0)
        self.margin = np.empty(0)
        self.roams = np.empty(0, np.bool_)
        self._ess = np.empty(0)

    def __len__(self) -> int:
        return len(self.poses)

    def find(
        self, draws: NDArray[np.float32], taken: NDArray[np.float64], most: int, time: float, margin: float
    ) -> int:
        """Follow up to ``most`` places where ``draws`` (3, n) from a search lie densest, apart from the poses ``taken``
        (k, 3) and from those already followed; returns how many there were."""
        bins = np.floor(draws / np.array([[APART_D], [APART_D], [APART_A]], np.float32)).astype(np.int64)
        bins -= bins.min(axis=1, keepdims=True)
        _, bin_of, count = np.unique(np.ravel_multi_index(bins, bins.max(axis=1) + 1), False, True, True)
        by_bin, last = np.argsort(bin_of, kind="stable"), np.cumsum(count)
        known, found = np.vstack([taken, self.poses]), list[NDArray[np.float32]]()
        for densest in np.argsort(-count, kind="stable"):
            if len(found) >= most:
                break
            there = draws[:, by_bin[last[densest] - count[densest] : last[densest]]]
            pose = np.median(there, axis=1).astype(np.float64)
            if not same_place(pose, known).any():
                known = np.vstack([known, pose])
                found.append(there[:, np.arange(EACH) * there.shape[1] // EACH])
        if found:
            self._join(np.stack(found, axis=1), time, margin, roams=False)
        return len(found)

    def adopt(
        self, poses: NDArray[np.float32], weights: NDArray[np.float64], time: float, scan: int, margin: float
    ) -> None:
        """Follow also the place of these poses (3, n), with weights (n,) that sum to one; it comes last."""
        key = stream_key(self._seed, scan, self._stream)
        survivors = low_variance(weights, EACH, key)
        self._join(poses[:, None, survivors], time, margin, roams=True)

    def keep(self, rows: NDArray[np.int64]) -> None:
        """Only these are followed any longer, in this order."""
        self.particles = np.ascontiguousarray(self.particles[:, rows])
        self.weights = self.weights[rows]
        self.poses, self.began, self._ess = self.poses[rows], self.began[rows], self._ess[rows]
        self.margin, self.roams = self.margin[rows], self.roams[rows]

    def follow(self, prior: Prior, reading: Reading, scan: int) -> None:
        """Every rival takes one turn: resample, predict, weigh."""
        if not len(self):
            return
        for row in np.flatnonzero(self._ess < LEAST_ESS * EACH):
            # The same offset serves all rows: they are not compared particle by particle.
            key = stream_key(self._seed, scan, self._stream + 1)
            survivors = low_variance(self.weights[row], EACH, key)
            self.particles[:, row] = self.particles[:, row, survivors]
            self.weights[row] = 1.0 / EACH
        flat = self.particles.reshape(3, -1)
        before = flat.copy()
        self._mover.move(flat, prior.loosely, stream_key(self._seed, scan, self._stream + 2))
        log_likelihood = np.empty(flat.shape[1], np.float32)
        self._sensor.score(flat, reading, log_likelihood)
        by_row = log_likelihood.reshape(self.weights.shape)
        for row in np.flatnonzero(self.roams):
            came, went = before.reshape(self.particles.shape)[:, row], np.ascontiguousarray(self.particles[:, row])
            self._sensor.score(went, reading, by_row[row], came)
        places.weigh(self.weights, by_row, reading.temper, self._ess)
        places.mean_poses(*self.particles, self.weights, self.poses)

    def covariance(self, row: int) -> NDArray[np.float64]:
        """(3, 3) of x, y, theta of one rival's particles, in the grid frame."""
        delta = self.particles[:, row] - self.poses[row][:, None]
        delta[2] = wrap_angle(delta[2])
        return np.asarray((self.weights[row] * delta) @ delta.T, np.float64)

    def _join(self, particles: NDArray[np.float32], time: float, margin: float, roams: bool) -> None:
        new = particles.shape[1]
        self.particles = np.ascontiguousarray(np.concatenate([self.particles, particles], axis=1))
        self.weights = np.vstack([self.weights, np.full((new, EACH), 1.0 / EACH)])
        self.began = np.append(self.began, np.full(new, time))
        self.margin = np.append(self.margin, np.full(new, margin))
        self.roams = np.append(self.roams, np.full(new, roams))
        self._ess = np.append(self._ess, np.full(new, float(EACH)))
        self.poses = np.empty((len(self.weights), 3))
        places.mean_poses(*self.particles, self.weights, self.poses)


def same_place(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether poses are one place; both (..., 3), broadcast against each other."""
    near: NDArray[np.bool_] = np.hypot(a[..., 0] - b[..., 0], a[..., 1] - b[..., 1]) < APART_D
    return near & (np.abs(wrap_angle(a[..., 2] - b[..., 2])) < APART_A)
