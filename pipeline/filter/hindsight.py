"""Where the robot was, told by one who has seen the whole log: backward simulation (Godsill, Doucet and West, 2004)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.filter.estimate import Clusters
from pipeline.filter.particles import Particles
from pipeline.filter.resampling import low_variance
from pipeline.filter.rivals import Rivals
from pipeline.filter.step import Step
from pipeline.geometry import between, compose
from pipeline.kernels.random import stream_key, uniforms
from pipeline.kernels.smoothing import draw_predecessors
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.motion.models import Component
from pipeline.motion.prior import Prior
from pipeline.motion.witnesses import Motion

REMEMBERED = 4000
"""Particles kept of every update, drawn by weight: enough to hold every place that was in question at the start."""
PER_RIVAL = 5
"""Of a rival's particles every fifth is kept."""
TRAJECTORIES = 32
BANDWIDTH = (0.03, 0.03, 0.02)
"""m, m, rad added to the motion's deviations: finitely many particles cannot lie exactly where the motion would."""
JUMP = 3e-4
"""Density, relative to the motion's peak, of coming from anywhere: how a kidnapped robot arrives."""
SMOOTH = 5


class Hindsight:
    """Keeps the beliefs of a run, and then walks back through them from its end."""

    def __init__(self, grid: OccupancyGrid, config: Config) -> None:
        self._grid, self._config = grid, config
        self._way: list[NDArray[np.float64]] = []
        self._scans: list[int] = []
        self._priors: list[Prior | None] = []
        self._poses: list[NDArray[np.float32]] = []
        self._weights: list[NDArray[np.float32]] = []
        self._own = 0

    def follow(self, motion: Motion) -> None:
        """Take note of the dead reckoning at every scan, whether there is an update or not."""
        self._way.append(motion.pose)

    def remember(
        self, step: Step, particles: Particles, rivals: Rivals, odds: NDArray[np.float64], key: np.uint64
    ) -> None:
        """Keep the belief after an update, at most 4000 particles drawn by weight, and some of each of its rivals: one
        of them may turn out to have been right. ``odds`` (1 + rivals,) are the belief's and theirs."""
        if not self._config.hindsight:
            return
        own = min(particles.n, REMEMBERED)
        ancestors = low_variance(particles.weights, own, key)
        others = rivals.particles[:, :, ::PER_RIVAL]
        shares = np.append(odds[0] / own, np.repeat(odds[1:] / others.shape[2], others.shape[2]))
        self._scans.append(step.index)
        self._priors.append(step.prior)
        self._poses.append(np.ascontiguousarray(np.hstack([particles.poses[:, ancestors], others.reshape(3, -1)])))
        self._weights.append(np.append(np.full(own - 1, shares[0]), shares).astype(np.float32))
        self._own = own

    def trajectory(self, seed: int) -> NDArray[np.float64] | None:
        """(n, 3) poses in the map frame for the n scans of the log; None if nothing was kept.

        Draws whole trajectories backwards, each step by step among the particles of the time, weighted by how well the
        motion model connects them; reports the heaviest hypothesis among them.
        """
        if not self._scans:
            return None
        last = self._poses[-1]
        key = stream_key(seed, self._scans[-1], SMOOTH)
        # The verdict at the end is the belief's.
        pick = (uniforms(key, TRAJECTORIES) * self._own).astype(np.int64)
        places, which = np.unique(pick, return_inverse=True)
        at = last[:, places].T.astype(np.float64)
        walks = np.empty((len(self._scans), TRAJECTORIES, 3))
        walks[-1] = at[which]
        chosen = np.empty(TRAJECTORIES, np.int32)
        for k in range(len(self._scans) - 2, -1, -1):
            prior = self._priors[k + 1]
            assert prior is not None, "only the first update has no prior"
            ways = prior.witnesses
            moved = np.array([component.step for component in ways])
            std = np.array([_deviations(component) for component in ways])
            shares = np.array([component.share for component in ways])
            poses, key = self._poses[k], stream_key(seed, self._scans[k], SMOOTH)
            work = 8 * len(at) * poses.shape[1] * len(shares)
            draw_predecessors(work, *poses, self._weights[k], at, which, moved, std, shares, JUMP, key, chosen)
            places, which = np.unique(chosen, return_inverse=True)
            at = poses[:, places].T.astype(np.float64)
            walks[k] = at[which]
        return self._fill(self._agree(walks))

    def _agree(self, walks: NDArray[np.float64]) -> NDArray[np.float64]:
        """The heaviest hypothesis among the walks (k, trajectories, 3) at each update: (k, 3) in the map frame."""
        clusters = Clusters(self._grid, TRAJECTORIES)
        equal = np.full(TRAJECTORIES, 1.0 / TRAJECTORIES)
        out = np.empty((len(walks), 3))
        for k, at in enumerate(walks):
            out[k] = clusters.find(np.ascontiguousarray(at.T.astype(np.float32)), equal)[0].pose
        return out

    def _fill(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Poses for every scan: where the robot stood (nearly) still, the witnesses lead on from the last update."""
        scans, way = np.array(self._scans), np.array(self._way)
        row = np.searchsorted(scans, np.arange(len(way)), side="right") - 1
        return compose(poses[row], between(way[scans[row]], way))


def _deviations(component: Component) -> NDArray[np.float64]:
    """(3,) along, across and in heading; widened, since finitely many particles cannot lie exactly where they must."""
    if (m := component.table) is not None:
        turn = float(np.hypot(m.std_rot1, m.std_rot2))
        return np.hypot([m.std_trans, abs(m.trans) * m.std_rot1, turn], BANDWIDTH)
    return np.hypot(np.sqrt(np.diag(component.covariance)), BANDWIDTH)
