"""The belief: weighted poses, and what can happen to them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels import BLOCK, belief
from pipeline.kernels.resampling import gather


class Particles:
    """Up to ``capacity`` particles in buffers that are used again at every scan.

    Poses are (3, n) float32 in the grid frame: x, y, theta each contiguous. Weights are kept as logarithms;
    ``weights`` are their exponentials, and sum to one.
    """

    def __init__(self, capacity: int) -> None:
        # Two sets of poses: survivors are gathered from one into the other.
        self._store, self._spare = np.empty((3, capacity), np.float32), np.empty((3, capacity), np.float32)
        self._log_weights, self._weights = np.empty(capacity), np.empty(capacity)
        self._log_likelihood = np.zeros(capacity, np.float32)
        self.n = 0
        self.ess = 0.0

    @property
    def capacity(self) -> int:
        """The most particles that there can be."""
        return self._store.shape[1]

    @property
    def poses(self) -> NDArray[np.float32]:
        """(3, n) x, y, theta in the grid frame; each row contiguous."""
        return self._store[:, : self.n]

    @property
    def weights(self) -> NDArray[np.float64]:
        """(n,) summing to one."""
        return self._weights[: self.n]

    @property
    def log_weights(self) -> NDArray[np.float64]:
        """(n,) logarithms of the weights."""
        return self._log_weights[: self.n]

    @property
    def log_likelihood(self) -> NDArray[np.float32]:
        """(n,) of the latest scan at each pose, untempered."""
        return self._log_likelihood[: self.n]

    def place(self, poses: NDArray[np.float32]) -> None:
        """Start anew with these poses (3, n), all of equal weight."""
        self.n = poses.shape[1]
        self.poses[:] = poses
        self._equal_weights()

    def weigh(self, temper: float) -> float:
        """Every particle gains its tempered log-likelihood; then the weights sum to one again.

        Returns the log-evidence of the scan: the logarithm of the weighted mean of the tempered likelihood.
        """
        n = self.n
        blocks = -(-n // BLOCK)
        work = np.empty(blocks), np.empty((blocks, 2))
        evidence, self.ess = belief.weigh(10 * n, self.log_weights, self.log_likelihood, temper, self.weights, *work)
        return float(evidence)

    def survive(self, ancestors: NDArray[np.int32]) -> None:
        """Only these particles go on, in so many copies as they are named, all of equal weight."""
        m = len(ancestors)
        gather(10 * m, self.poses, ancestors, self._spare[:, :m])
        self._store, self._spare = self._spare, self._store
        self.n = m
        self._equal_weights()

    def admit(self, poses: NDArray[np.float32], share: float) -> None:
        """New poses (3, m) join with this share of the weight between them; room must have been left for them."""
        n, m = self.n, poses.shape[1]
        self.log_weights[:] += math.log1p(-share)
        self.weights[:] *= 1.0 - share
        self._store[:, n : n + m] = poses
        self._log_weights[n : n + m] = math.log(share / m)
        self._weights[n : n + m] = share / m
        self._log_likelihood[n : n + m] = self._log_likelihood[:n].mean()
        self.n = n + m
        self.ess = 1.0 / float(np.square(self.weights).sum())

    def mean_log_likelihood(self) -> float:
        """Weighted mean over the particles of the latest scan's log-likelihood."""
        sums = np.empty(-(-self.n // BLOCK))
        belief.weighted_sum(2 * self.n, self.log_likelihood, self.weights, sums)
        return float(sums.sum())

    def spread(self, x: float, y: float) -> float:
        """RMS distance of the weighted particles from a point of the grid frame, m."""
        sums = np.empty(-(-self.n // BLOCK))
        belief.squared_distance(4 * self.n, *self.poses[:2], x, y, self.weights, sums)
        return math.sqrt(float(sums.sum()))

    def _equal_weights(self) -> None:
        self.log_weights.fill(-math.log(self.n))
        self.weights.fill(1.0 / self.n)
        self.ess = float(self.n)
