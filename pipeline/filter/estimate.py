"""Where the robot is: the hypotheses in a belief, and how sure it is of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.filter.step import Estimate
from pipeline.kernels.clusters import MOST, find_clusters
from pipeline.maps.occupancy_grid import OccupancyGrid

BIN_SIZE = 0.5
BIN_TURNS = 36
"""Bins of 0.5 m x 0.5 m x 10 degrees, as in AMCL's kd-tree."""
LIGHTEST_BIN = 0.05
"""Bins below this share of the heaviest one join no cluster: a thin haze must not connect two places."""


class Clusters:
    """Groups the particles into hypotheses, in buffers that are used again at every scan."""

    def __init__(self, grid: OccupancyGrid, max_particles: int) -> None:
        self._origin = np.array(grid.origin, np.float64)
        self._bins = 0
        self._table = np.empty((1024, 2), np.int64)  # grows as need be
        self._bin_of, self._keys = np.empty(max_particles, np.int32), np.empty(max_particles, np.int64)
        self._heavy, self._parent, self._row_of_bin = (np.empty(max_particles, np.int32) for _ in range(3))
        self._bin_weights, self._share = np.empty(max_particles), np.empty(max_particles)

    @property
    def bin_weights(self) -> NDArray[np.float64]:
        """Weights of the bins that hold a particle: what KLD-sampling counts."""
        return self._bin_weights[: self._bins]

    def find(self, poses: NDArray[np.float32], weights: NDArray[np.float64]) -> tuple[Estimate, ...]:
        """The hypotheses, heaviest first, in the map frame.

        ``poses`` (3, n) float32 in the grid frame, ``weights`` (n,) float64 summing to one. Each estimate has the
        weight, mean and covariance of a connected set of bins: never the mean of two places.
        """
        shares, means = np.empty(MOST), np.empty((MOST, 3))
        covariances = np.empty((MOST, 3, 3))
        while True:
            bins, k = find_clusters(
                *poses, weights, BIN_SIZE, BIN_TURNS, LIGHTEST_BIN, self._origin, self._table, self._bin_of, self._keys,
                self._bin_weights, self._heavy, self._parent, self._row_of_bin, self._share, shares, means, covariances,
            )  # fmt: skip
            if bins >= 0:
                break
            self._table = np.empty((2 * len(self._table), 2), np.int64)
        self._bins = bins
        return tuple(map(Estimate, means[:k], covariances[:k], shares[:k].tolist()))


def map_estimate(
    grid: OccupancyGrid, pose: NDArray[np.float64], covariance: NDArray[np.float64], weight: float
) -> Estimate:
    """An estimate in the map frame from a pose (3,) and its covariance (3, 3) in the grid frame."""
    cos, sin = np.cos(grid.origin[2]), np.sin(grid.origin[2])
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return Estimate(grid.to_map(pose), turn @ covariance @ turn.T, weight)
