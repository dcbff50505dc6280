"""Monte Carlo localization (Probabilistic Robotics, Table 8.2): predict, weigh, estimate, resample."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.filter.beam_model import BeamModel
from pipeline.filter.estimate import Clusters
from pipeline.filter.expected_ranges import ExpectedRanges, select_beams
from pipeline.filter.initialization import initial_particles
from pipeline.filter.motion_model import odometry_motion
from pipeline.filter.narrator import Narrator
from pipeline.filter.resampling import draw_ancestors
from pipeline.filter.step import Beams, Estimate, Step
from pipeline.geometry import between, compose
from pipeline.kernels import belief
from pipeline.kernels.motion import move
from pipeline.kernels.random import normal_quantiles, stream_key
from pipeline.kernels.resampling import gather
from pipeline.logs.messages import Laser, Scan
from pipeline.maps.occupancy_grid import OccupancyGrid

INITIAL, MOTION, RESAMPLE = range(3)
"""Purposes of random numbers: each has its own stream at every scan."""
EXPLAINED_WITHIN = 0.3
"""Metres: a beam is explained if it ends so close to where the map says it must."""


class ParticleFilter:
    """The belief as weighted particles, updated by one scan at a time.

    Poses are kept in the grid frame as (3, n) float32: x, y, theta each contiguous. Weights are kept as logarithms.
    The same grid, laser, config, seed and scans give the same steps, whatever the number of threads.
    """

    def __init__(self, grid: OccupancyGrid, laser: Laser, config: Config, seed: int = 0) -> None:
        self._grid, self._laser, self._config, self._seed = grid, laser, config, seed
        self._beams = select_beams(laser, config)
        max_range = config.laser_max_range or laser.range_max
        self._expected = ExpectedRanges(grid, laser, self._beams, config, max_range)
        self._model = BeamModel(config, self._expected.codes, max_range)
        self._clusters = Clusters(grid, config.max_particles)
        self._narrator = Narrator()
        self._quantiles = normal_quantiles()
        # Two sets of poses: survivors are gathered from one into the other.
        self._poses = initial_particles(grid, config, int(stream_key(seed, 0, INITIAL)))
        self._spare = np.empty_like(self._poses)
        n = self._poses.shape[1]
        self._log_likelihood = np.zeros(n, np.float32)
        self._log_weights = np.full(n, -math.log(n))
        self._weights = np.full(n, 1.0 / n)
        self._map_poses = np.empty((n, 3), np.float32)
        self._odometry: NDArray[np.float64] | None = None
        self._estimate: tuple[Estimate, ...] = ()
        self._resample_due = False

    def update(self, scan: Scan) -> Step:
        """Let one scan change the belief; a robot that stands still teaches nothing new, so nothing changes then."""
        if len(scan.ranges) != self._laser.beams:
            raise MclError(f"scan {scan.index} has {len(scan.ranges)} ranges, the laser {self._laser.beams} beams")
        resampled = self._resample(scan) if self._resample_due else False
        moved = self._moved(scan)
        ranges = self._model.correct(scan.ranges[self._beams])
        if moved:
            self._predict(scan)
            self._weigh(ranges)
            self._estimate = self._clusters.find(self._poses, self._weights)
        return self._step(scan, ranges, moved, resampled)

    def _moved(self, scan: Scan) -> bool:
        if self._odometry is None:
            return True
        dx, dy, turn = between(self._odometry, scan.odometry)
        return math.hypot(dx, dy) >= self._config.update_min_d or abs(turn) >= self._config.update_min_a

    def _predict(self, scan: Scan) -> None:
        """Every particle drives as the odometry says, each with noise of its own (Table 5.6)."""
        if self._odometry is not None:
            m = odometry_motion(self._odometry, scan.odometry, self._config)
            key = stream_key(self._seed, scan.index, MOTION)
            n = self._poses.shape[1]
            move(30 * n, *self._poses, m.rot1, m.trans, m.rot2, m.std_rot1, m.std_trans, m.std_rot2, key, self._quantiles)  # fmt: skip
        self._odometry = scan.odometry

    def _weigh(self, ranges: NDArray[np.float32]) -> None:
        """Every particle gains the tempered log-likelihood of the scan at its pose; then the weights sum to one."""
        rows = self._model.scan_rows(ranges)
        self._expected.score(self._poses, rows, self._model.outside(ranges), self._log_likelihood)
        n = len(self._weights)
        blocks = -(-n // belief.BLOCK)
        largest, sums = np.empty(blocks), np.empty((blocks, 2))
        belief.add_likelihood(2 * n, self._log_weights, self._log_likelihood, self._config.temper, largest)
        top = float(largest.max())
        belief.exponentiate(20 * n, self._log_weights, top, self._weights, sums)
        total, squares = sums.sum(axis=0)
        belief.rescale(2 * n, self._log_weights, self._weights, top + math.log(total), 1.0 / total, largest)
        self._ess = total**2 / squares
        self._resample_due = self._ess < self._config.resample_ess * n or self._config.resample_ess == 1.0

    def _resample(self, scan: Scan) -> bool:
        """Survivors replace the particles: done at the next scan, so that a step can show the weights that chose them."""
        n = self._poses.shape[1]
        key = stream_key(self._seed, scan.index, RESAMPLE)
        ancestors = draw_ancestors(self._weights, n, self._config.resampler, key)
        gather(10 * n, self._poses, ancestors, self._spare)
        self._poses, self._spare = self._spare, self._poses
        self._log_weights.fill(-math.log(n))
        self._weights.fill(1.0 / n)
        self._resample_due = False
        return True

    def _step(self, scan: Scan, ranges: NDArray[np.float32], moved: bool, resampled: bool) -> Step:
        n = self._poses.shape[1]
        best = self._estimate[0]
        # While the robot (nearly) stands still, the estimate follows the odometry, as the next prediction will.
        drift = between(self._odometry, scan.odometry) if self._odometry is not None else np.zeros(3)
        pose = compose(best.pose, drift)
        estimate = Estimate(pose, best.covariance, best.weight)
        beams = self._beams_at(pose, ranges)
        belief.to_map(3 * n, *self._poses, *self._grid.origin, self._map_poses)
        counted = np.isfinite(ranges)
        explained = np.abs(beams.measured - beams.expected)[counted] < EXPLAINED_WITHIN
        share = float(explained.mean()) if len(explained) else 0.0
        valid = max(1, int(np.count_nonzero(~np.isnan(ranges))))
        sums = np.empty(-(-n // belief.BLOCK))
        belief.weighted_sum(2 * n, self._log_likelihood, self._weights, sums)
        mean_log = float(sums.sum()) / valid
        spread = self._spread(estimate)
        step = Step(
            index=scan.index,
            stamp=scan.stamp,
            time=scan.time,
            particles=_read_only(self._map_poses),
            log_weights=_read_only(self._log_weights),
            estimate=estimate,
            clusters=(estimate, *self._estimate[1:]),
            beams=beams,
            ess=self._ess,
            mean_likelihood=math.exp(mean_log),
            explained=share,
            spread=spread,
            moved=moved,
            resampled=resampled,
        )
        return self._narrator.tell(step)

    def _spread(self, estimate: Estimate) -> float:
        """RMS distance of the weighted particles from the estimate, m."""
        x, y, _ = self._grid.to_grid(estimate.pose)
        sums = np.empty(-(-len(self._weights) // belief.BLOCK))
        belief.squared_distance(4 * len(self._weights), *self._poses[:2], x, y, self._weights, sums)
        return math.sqrt(float(sums.sum()))

    def _beams_at(self, pose: NDArray[np.float64], ranges: NDArray[np.float32]) -> Beams:
        expected = self._expected.at(self._grid.to_grid(pose))
        return Beams(compose(pose, self._laser.pose), self._laser.angles[self._beams], ranges, expected)


def _read_only(array: NDArray) -> NDArray:
    view = array.view()
    view.flags.writeable = False
    return view
