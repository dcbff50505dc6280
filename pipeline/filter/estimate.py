"""Where the robot is: the hypotheses in a belief, and how sure it is of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.filter.step import Estimate
from pipeline.kernels import belief
from pipeline.maps.occupancy_grid import OccupancyGrid

BIN_SIZE = 0.5
BIN_TURNS = 36
"""Bins of 0.5 m x 0.5 m x 10 degrees, as in AMCL's kd-tree."""
LIGHTEST_BIN = 0.05
"""Bins below this share of the heaviest one join no cluster: a thin haze must not connect two places."""
MAX_CLUSTERS = 8


class Clusters:
    """Groups the particles into hypotheses, in buffers that are used again at every scan."""

    def __init__(self, grid: OccupancyGrid, max_particles: int) -> None:
        self._grid = grid
        size = 1 << int(2 * max_particles).bit_length()
        self._keys = np.empty(size, np.int64)
        self._bin_at = np.empty(size, np.int32)
        self._bin_of = np.empty(max_particles, np.int32)
        self._bin_key = np.empty(max_particles, np.int64)
        self._bin_weight = np.empty(max_particles, np.float64)
        self._parent = np.empty(max_particles, np.int32)
        self._bins = 0

    @property
    def bin_weights(self) -> NDArray[np.float64]:
        """Weights of the bins that hold a particle: what KLD-sampling counts."""
        return self._bin_weight[: self._bins]

    def find(self, poses: NDArray[np.float32], weights: NDArray[np.float64]) -> tuple[Estimate, ...]:
        """The hypotheses, heaviest first, in the map frame.

        ``poses`` (3, n) float32 in the grid frame, ``weights`` (n,) float64 summing to one. Each estimate has the
        weight, mean and covariance of a connected set of bins: never the mean of two places.
        """
        x, y, theta = poses
        # The table is kept as small as the particles allow: clearing it is part of every scan.
        size = min(len(self._keys), 1 << int(2 * len(weights)).bit_length())
        keys, bin_at = self._keys[:size], self._bin_at[:size]
        bins = self._bins = belief.occupied_bins(
            x, y, theta, weights, BIN_SIZE, BIN_TURNS, keys, bin_at, self._bin_of, self._bin_key, self._bin_weight
        )
        bin_weight, parent = self._bin_weight[:bins], self._parent[:bins]
        floor = LIGHTEST_BIN * float(bin_weight.max())
        belief.label_bins(bins, BIN_TURNS, keys, bin_at, self._bin_key, self._bin_weight, floor, self._parent)
        joined = parent >= 0
        share = np.bincount(parent[joined], bin_weight[joined], minlength=bins)
        roots = np.argsort(-share, kind="stable")[:MAX_CLUSTERS]
        roots = roots[share[roots] > 0.0]
        slot_of_root = np.full(bins, -1, np.int32)
        slot_of_root[roots] = np.arange(len(roots))
        sums = np.zeros((len(roots), 14))
        belief.cluster_moments(x, y, theta, weights, self._bin_of, self._parent, slot_of_root, sums)
        return self._estimates(sums)

    def _estimates(self, sums: NDArray[np.float64]) -> tuple[Estimate, ...]:
        """From the moments (k, 14) of the clusters, all at once: numpy's overhead is dearer than the sums."""
        weight = sums[:, 0]
        delta, squares = sums[:, 4:7] / weight[:, None], sums[:, 7:13] / weight[:, None]
        covariance = squares[:, _SYMMETRIC] - delta[:, :, None] * delta[:, None, :]
        poses, turned = self._grid.to_map(sums[:, 1:4] + delta), _turned(self._grid, covariance)
        return tuple(Estimate(p, c, w) for p, c, w in zip(poses, turned, weight.tolist(), strict=True))


_SYMMETRIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])


def _turned(grid: OccupancyGrid, covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariances (..., 3, 3) of the grid frame in the map frame."""
    if grid.origin[2] == 0.0:
        return covariance
    cos, sin = np.cos(grid.origin[2]), np.sin(grid.origin[2])
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turn @ covariance @ turn.T, np.float64)


def map_estimate(
    grid: OccupancyGrid, pose: NDArray[np.float64], covariance: NDArray[np.float64], weight: float
) -> Estimate:
    """An estimate in the map frame from a pose (3,) and its covariance (3, 3) in the grid frame."""
    return Estimate(grid.to_map(pose), _turned(grid, covariance), weight)
