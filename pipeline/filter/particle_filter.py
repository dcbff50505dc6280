"""Monte Carlo localization (Probabilistic Robotics, Tables 8.2 to 8.4): predict, weigh, estimate, recover, resample."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.filter.adaptive import next_count
from pipeline.filter.beam_model import BeamModel
from pipeline.filter.estimate import Clusters
from pipeline.filter.expected_ranges import ExpectedRanges, select_beams
from pipeline.filter.hindsight import Hindsight
from pipeline.filter.initialization import initial_particles
from pipeline.filter.motion_model import odometry_motion
from pipeline.filter.narrator import Narrator
from pipeline.filter.particles import Particles
from pipeline.filter.range_bias import RangeBias
from pipeline.filter.recovery import Recovery, Rivals
from pipeline.filter.resampling import draw_ancestors
from pipeline.filter.step import Beams, Estimate, Step
from pipeline.geometry import between, compose
from pipeline.kernels import belief
from pipeline.kernels.random import stream_key
from pipeline.logs.messages import Laser, Scan
from pipeline.maps.occupancy_grid import OccupancyGrid

Scalar = TypeVar("Scalar", bound=np.generic)

INITIAL, MOTION, RESAMPLE, RECOVER, REMEMBER = range(5)
"""Purposes of random numbers: each has its own stream at every scan."""
EXPLAINED_WITHIN = 0.3
"""Metres: a beam is explained if it ends so close to where the map says it must."""
TRUSTED = 0.9
"""Weight of a hypothesis from which on its residuals may teach the range bias."""


class ParticleFilter:
    """The belief as weighted particles, updated by one scan at a time.

    The same grid, laser, config, seed and scans give the same steps, whatever the number of threads.
    """

    def __init__(self, grid: OccupancyGrid, laser: Laser, config: Config, seed: int = 0) -> None:
        self._grid, self._laser, self._config, self._seed = grid, laser, config, seed
        self._beams = select_beams(laser, config)
        max_range = config.laser_max_range or laser.range_max
        self._expected = ExpectedRanges(grid, laser, self._beams, config, max_range)
        self._model = BeamModel(config, self._expected.codes, max_range)
        self._bias = RangeBias(config, grid)
        self._allowed = grid.free(config.free_threshold)
        self._particles = Particles(config.max_particles)
        self._clusters = Clusters(grid, config.max_particles)
        self._recovery = Recovery(grid, config, self._model, self._expected, self._allowed)
        self._narrator = Narrator()
        self.hindsight = Hindsight(grid, config)
        self._map_poses = np.empty((config.max_particles, 3), np.float32)
        self._odometry: NDArray[np.float64] | None = None
        self._hypotheses: tuple[Estimate, ...] = ()
        self._resample_due = False
        self._rivals: Rivals | None = None

    def update(self, scan: Scan) -> Step:
        """Let one scan change the belief; a robot that stands still teaches nothing new, so nothing changes then."""
        if len(scan.ranges) != self._laser.beams:
            raise MclError(f"scan {scan.index} has {len(scan.ranges)} ranges, the laser {self._laser.beams} beams")
        ranges = self._model.correct(scan.ranges[self._beams], self._bias.value)
        self._rivals, resampled = None, False
        if moved := self._moved(scan):
            resampled = self._resample(scan)
            self._predict(scan, ranges)
            self._weigh(ranges)
            self._admit_rivals(scan, ranges)
            self._hypotheses = self._clusters.find(self._particles.poses, self._particles.weights)
        step = self._step(scan, ranges, moved, resampled)
        if moved:
            self._learn(step)
        return step

    def _moved(self, scan: Scan) -> bool:
        if self._odometry is None:
            return True
        dx, dy, turn = between(self._odometry, scan.odometry)
        return math.hypot(dx, dy) >= self._config.update_min_d or abs(turn) >= self._config.update_min_a

    def _predict(self, scan: Scan, ranges: NDArray[np.float32]) -> None:
        if self._odometry is None:
            self._start(ranges)
        else:
            motion = odometry_motion(self._odometry, scan.odometry, self._config)
            self._particles.predict(motion, stream_key(self._seed, scan.index, MOTION))
        self._odometry = scan.odometry

    def _start(self, ranges: NDArray[np.float32]) -> None:
        """Particles where config.init says; an exhaustive start has to see the first scan for that."""
        key = stream_key(self._seed, 0, INITIAL)
        if self._config.init == "exhaustive":
            self._particles.place(self._search(ranges, self._config.max_particles, key))
        else:
            self._particles.place(initial_particles(self._grid, self._config, int(key)))

    def _search(self, ranges: NDArray[np.float32], n: int, key: np.uint64) -> NDArray[np.float32]:
        """(3, n) poses drawn from what this scan alone says of the whole building."""
        rows = self._model.scan_rows(ranges)
        return self._expected.posterior(rows, self._config.independent_beams, self._allowed, n, key).poses

    def _weigh(self, ranges: NDArray[np.float32]) -> None:
        """Every particle is weighed by how well its pose explains the scan."""
        p = self._particles
        self._expected.score(p.poses, self._model.scan_rows(ranges), self._model.outside(ranges), p.log_likelihood)
        p.weigh(self._model.temper(ranges))
        self._resample_due = p.ess < self._config.resample_ess * p.n or self._config.resample_ess == 1.0

    def _resample(self, scan: Scan) -> bool:
        """Survivors replace the particles: before the next scan, so that a step shows the weights that chose them."""
        if not self._resample_due:
            return False
        p = self._particles
        n = next_count(p.n, p.weights, self._clusters.bin_weights, self._config)
        key = stream_key(self._seed, scan.index, RESAMPLE)
        p.survive(draw_ancestors(p.weights, n, self._config.resampler, key))
        self._resample_due = False
        return True

    def _admit_rivals(self, scan: Scan, ranges: NDArray[np.float32]) -> None:
        """A belief in doubt is given rivals from the whole building; the scans to come decide between them."""
        p, key = self._particles, stream_key(self._seed, scan.index, RECOVER)
        self._rivals = self._recovery.rivals(p, ranges, scan.odometry, scan.time, key)
        if self._rivals is None:
            return
        room = p.capacity - self._rivals.poses.shape[1]
        if p.n > room:
            p.survive(draw_ancestors(p.weights, room, "low_variance", key))
        p.admit(self._rivals.poses, self._rivals.share)

    def _learn(self, step: Step) -> None:
        if step.estimate.weight > TRUSTED:
            self._bias.learn(step.beams.measured, step.beams.expected)
        self._recovery.observe(step)
        key = stream_key(self._seed, step.index, REMEMBER)
        self.hindsight.remember(step.index, self._particles.poses, self._particles.weights, key)

    def _step(self, scan: Scan, ranges: NDArray[np.float32], moved: bool, resampled: bool) -> Step:
        p, best = self._particles, self._hypotheses[0]
        # While the robot (nearly) stands still, the estimate follows the odometry, as the next prediction will.
        drift = between(self._odometry, scan.odometry)  # type: ignore[arg-type]
        estimate = Estimate(compose(best.pose, drift), best.covariance, best.weight)
        in_grid = self._grid.to_grid(estimate.pose)
        expected = self._expected.at(in_grid)
        laser = compose(estimate.pose, self._laser.pose)
        beams = Beams(laser, self._laser.angles[self._beams], ranges, expected)
        belief.to_map(3 * p.n, *p.poses, *self._grid.origin, self._map_poses)
        valid = max(1, int(np.count_nonzero(~np.isnan(ranges))))
        step = Step(
            index=scan.index,
            stamp=scan.stamp,
            time=scan.time,
            particles=_read_only(self._map_poses[: p.n]),
            log_weights=_read_only(p.log_weights),
            estimate=estimate,
            clusters=(estimate, *self._hypotheses[1:]),
            beams=beams,
            ess=p.ess,
            mean_likelihood=math.exp(p.mean_log_likelihood() / valid),
            explained=explained_share(beams),
            spread=p.spread(in_grid[0], in_grid[1]),
            moved=moved,
            resampled=resampled,
        )
        return self._narrator.tell(step, self._recovery.explained, self._rivals)


def explained_share(beams: Beams) -> float:
    """Share of the beams with a return that end within 0.3 m of where the map says they must; 0 without any."""
    counted = np.isfinite(beams.measured)
    if not np.any(counted):
        return 0.0
    return float(np.mean(np.abs(beams.measured[counted] - beams.expected[counted]) < EXPLAINED_WITHIN))


def _read_only(array: NDArray[Scalar]) -> NDArray[Scalar]:
    view = array.view()
    view.flags.writeable = False
    return view
