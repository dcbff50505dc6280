"""Particles follow the motion prior: each one of its components, with noise of its own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.geometry import wrap_angle
from pipeline.kernels import motion
from pipeline.kernels.random import normal_quantiles, stream_key
from pipeline.motion.models import Component
from pipeline.motion.prior import Prior

OWN = 40
"""Purpose of random numbers: steps of a motion model of the user's own."""


class Mover:
    """Moves particles by a motion prior."""

    def __init__(self) -> None:
        self._quantiles = normal_quantiles()

    def move(self, poses: NDArray[np.float32], prior: Prior, key: np.uint64) -> None:
        """Poses (3, n) float32 of the grid frame make the move, in place, with noise from the stream ``key``."""
        ways = np.array([_way(component) for component in prior.components], np.float32)
        sampled = self._sampled(poses, prior, key)
        motion.move(30 * poses.shape[1], *poses, ways, way_of(prior), key, self._quantiles)
        for which, moved in sampled:
            poses[:, which] = moved
            poses[2, which] = wrap_angle(poses[2, which])

    def _sampled(
        self, poses: NDArray[np.float32], prior: Prior, key: np.uint64
    ) -> list[tuple[NDArray[np.intp], NDArray[np.float64]]]:
        """Particles that a model of the user's own moves: which, and where they come to be, (3, m)."""
        own = [(k, c.sampled) for k, c in enumerate(prior.components) if c.sampled is not None]
        if not own:
            return []
        taken = np.empty(poses.shape[1], np.int32)
        motion.taken(way_of(prior), key, taken)
        found = []
        for k, sampled in own:
            which = np.flatnonzero(taken == k)
            if len(which):
                found.append((which, sampled.move(poses[:, which], int(stream_key(int(key), k, OWN)))))
        return found

    def followed(self, weights: NDArray[np.float64], prior: Prior, key: np.uint64) -> NDArray[np.float64]:
        """(components,): how much of the weights (n,), given after the move, is of particles that followed each."""
        shares = np.ones(len(prior.components))
        if len(shares) == 1:
            return shares
        motion.followed(weights, way_of(prior), key, shares)
        return shares


def way_of(prior: Prior) -> NDArray[np.int32]:
    """(256,) int32: the component that a particle follows, for its eight random bits: in proportion to the shares."""
    shares = np.array([component.share for component in prior.components])
    upto = np.rint(np.cumsum(shares) / shares.sum() * motion.SHARES)
    return np.searchsorted(upto, np.arange(motion.SHARES), side="right").astype(np.int32)


def _way(component: Component) -> tuple[float, ...]:
    """The component as ``kernels.motion.move`` takes it."""
    if (m := component.table) is not None:
        return (m.rot1, m.std_rot1, m.trans, 0.0, m.std_trans, 0.0, 0.0, 0.0, m.rot2, 0.0, 0.0, m.std_rot2)
    (dx, dy, turn), (a, b, c) = component.step.tolist(), np.linalg.cholesky(component.covariance).tolist()
    return (0.0, 0.0, dx, a[0], 0.0, dy, b[0], b[1], turn, c[0], c[1], c[2])
