"""Likelihood fields for a range finder (Probabilistic Robotics, Section 6.4 and Table 6.3), the book's and AMCL's.

A beam is judged by how far from any obstacle it ends, whatever stands in its way: smooth in the pose and cheap, but
blind to walls between the robot and the end, and to readings without return, which all of these models skip. A pose
in a wall or off the map is judged by its beams' ends like any other.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.config import Config
from pipeline.kernels import BLOCK, field
from pipeline.logs.messages import Laser
from pipeline.maps.distance_field import build_distance_field
from pipeline.maps.occupancy_grid import OccupancyGrid

CONVERGED_WITHIN = 0.5
"""Metres from their mean, in x and in y, within which all particles must lie for beams to be skipped (AMCL's
``dist_threshold``)."""
LEAST = 1e-37
"""No reading is less likely: its logarithm must stay finite where z_rand is zero."""


def field_likelihood(distance: ArrayLike, config: Config, max_range: float) -> NDArray[np.float64]:
    """p(z) of a beam that ends ``distance`` metres from the nearest obstacle, as ``config.sensor_model`` has it.

    ``likelihood_field``: Table 6.3, z_hit * N(distance; 0, sigma_hit) + z_rand / max_range, per metre. AMCL's two leave
    out the Gaussian's factor 1 / (sqrt(2 pi) sigma_hit), so that with a small sigma_hit a hit counts for less.
    """
    sigma = config.sigma_hit
    hit = np.exp(-0.5 * (np.asarray(distance, np.float64) / sigma) ** 2)
    if config.sensor_model == "likelihood_field":
        hit = hit / (math.sqrt(2.0 * math.pi) * sigma)
    return config.z_hit * hit + config.z_rand / max_range


class LikelihoodField:
    """Log-likelihoods of a scan's ends, at any pose on the map.

    ``likelihood_field`` and ``likelihood_field_prob`` multiply the beams' p(z). ``likelihood_field_prob`` with
    ``do_beamskip`` leaves out beams that most particles cannot explain, once all particles are in one place.
    ``likelihood_field_cubes`` is what AMCL calls likelihood_field: the likelihood is 1 + sum of p(z)^3.
    """

    def __init__(
        self, grid: OccupancyGrid, laser: Laser, angles: NDArray[np.float64], config: Config, max_range: float
    ):
        self._config = config
        self._cubes = config.sensor_model == "likelihood_field_cubes"
        self._skips = config.sensor_model == "likelihood_field_prob" and config.do_beamskip
        x, y, yaw = laser.pose
        self._at = np.array([[x], [y]])
        self._directions = np.stack([np.cos(angles + yaw), np.sin(angles + yaw)])
        self._inv_resolution = np.float32(1.0 / grid.resolution)
        distances = build_distance_field(
            grid, grid.wall_threshold(config.occupied_threshold), config.laser_likelihood_max_dist
        )
        self._codes = distances.codes
        self._near = int(np.searchsorted(distances.distances, config.beam_skip_distance))
        p = field_likelihood(distances.distances, config, max_range)
        self._values = (p**3 if self._cubes else np.log(np.maximum(p, LEAST))).astype(np.float32)

    def read(self, ranges: NDArray[np.float32]) -> NDArray[np.float32]:
        """(2, m) float32 cells: ends of the beams that came back, seen from the robot; ``ranges`` (k,) m, corrected."""
        back = np.isfinite(ranges)
        metres = self._at + ranges[back] * self._directions[:, back]
        return np.ascontiguousarray(metres * self._inv_resolution, np.float32)

    def temper(self, beams: int) -> float:
        """Exponent on the likelihood of so many beams: they may count as ``independent_beams``, and no more.

        Not for the sum of cubes, which is AMCL's own way of not taking beams for independent.
        """
        independent = self._config.independent_beams
        return 1.0 if self._cubes or independent is None or beams == 0 else min(1.0, independent / beams)

    def voices(self, beams: int) -> int:
        """How many factors the likelihood of so many beams has, at least one: a sum of cubes is a single one."""
        return 1 if self._cubes else max(1, beams)

    def score(self, poses: NDArray[np.float32], ends: NDArray[np.float32], out: NDArray[np.float32]) -> None:
        """Log-likelihood, untempered, at poses (3, n) float32 of the grid frame -> ``out`` (n,) float32."""
        kept = ends
        if self._skips and _converged(poses):
            kept = np.ascontiguousarray(ends[:, self.agreed(poses, ends)])
        work = poses.shape[1] * (10 + kept.shape[1])
        field.score_field(work, *poses, *kept, self._inv_resolution, self._codes, self._values, out)
        if self._cubes:
            np.log1p(out, out=out)
        elif skipped := ends.shape[1] - kept.shape[1]:
            # As if it ended nowhere near anything, at every particle: the weights are AMCL's, and a belief that skips
            # beams gains no evidence by it over one that does not.
            out += np.float32(skipped * float(self._values[-1]))

    def agreed(self, poses: NDArray[np.float32], ends: NDArray[np.float32]) -> NDArray[np.bool_]:
        """(m,) the beams that are used, as AMCL's beam skipping has it: those that end within ``beam_skip_distance`` of
        an obstacle at more than the share ``beam_skip_threshold`` of the particles; all of them, if that left out
        the share ``beam_skip_error_threshold`` or more, since then the particles rather than the beams are wrong.

        Shares are of the beams that came back; AMCL counts those without return as left out.
        """
        n, m = poses.shape[1], ends.shape[1]
        counts = np.empty((-(-n // BLOCK), m), np.int64)
        field.count_near(n * (10 + m), *poses, *ends, self._inv_resolution, self._codes, self._near, counts)
        agreed = counts.sum(axis=0) > self._config.beam_skip_threshold * n
        if np.count_nonzero(~agreed) >= self._config.beam_skip_error_threshold * m:
            agreed[:] = True
        return np.asarray(agreed, np.bool_)


def _converged(poses: NDArray[np.float32]) -> bool:
    xy = poses[:2]
    off = np.abs(xy - xy.mean(axis=1, keepdims=True, dtype=np.float64))
    return bool(off.max() <= CONVERGED_WITHIN)
