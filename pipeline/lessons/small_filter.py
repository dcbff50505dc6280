"""A small particle filter in plain NumPy, put together from the lessons' functions: each of them can be another's."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.filter.step import Estimate
from pipeline.filter.substeps import Kind, SubStep
from pipeline.geometry import wrap_angle
from pipeline.lessons.drive import LONGEST, Drive
from pipeline.lessons.exam import Array, Function

ALPHAS = np.array([0.02, 0.02, 0.02, 0.002])
BEAM = {"z_hit": 0.6, "z_short": 0.2, "z_max": 0.05, "z_rand": 0.15, "sigma_hit": 0.2, "lambda_short": 0.5}
FIELD = {"z_hit": 0.7, "z_rand": 0.3, "sigma_hit": 0.2}
TEMPER = 0.25
"""Exponent on a scan's likelihood: beams err together."""
LEAST = 1e-12
"""Nothing is less likely, so that no logarithm is infinite."""
BIN = np.array([0.5, 0.5, np.deg2rad(10.0)])
"""m, m, rad: of the bins that KLD-sampling counts."""
KLD = (0.05, 2.33)
RATES = (0.05, 0.5)
"""Of the slow and the fast average of augmented MCL."""


@dataclass
class Filter:
    """Monte Carlo localization along a drive (Table 8.2), from a cloud about the robot's true place.

    ``parts``: the lessons' functions by name. ``model``: how scans are weighed, by the beam model with the drive's own
    ranges, with rays of the part ``ray_cast``, or by the likelihood field. ``weighs_moves``: particles move anywhere
    near, and the density of the move counts for their weight, so that ``motion_model_odometry`` is what moves them.
    ``adapts``: their number is that of KLD-sampling. ``draws_random``: as augmented MCL has it. ``tell``: hears of
    every sub-step. After a run: ``counts`` and ``shares`` (scans) of particles and of random ones among them, and how
    often it ``resampled``.
    """

    drive: Drive
    parts: Mapping[str, Function]
    n: int
    seed: int = 0
    deviations: tuple[float, float, float] = (0.5, 0.5, 0.2)
    model: str = "beam"
    weighs_moves: bool = False
    adapts: bool = False
    draws_random: bool = False
    tell: Callable[[SubStep], None] = lambda _: None
    counts: list[int] = field(default_factory=list)
    shares: list[float] = field(default_factory=list)
    resampled: int = 0
    _estimate: Estimate | None = None

    def run(self, carried: int | None = None) -> Array:
        """(scans,) m: how far the weighted mean is from the truth.

        ``carried``: the scan before which somebody carried the robot off, so that its wheels said nothing.
        """
        drive, rng = self.drive, np.random.default_rng([82, self.seed])
        poses = drive.truth[0] + rng.standard_normal((self.n, 3)) * self.deviations
        log_weights, slow, fast, share = np.zeros(self.n), 0.0, 0.0, 0.0
        errors = []
        for k in range(len(drive)):
            weights = _normalised(log_weights)
            if k and (self.draws_random or _number(self.parts["effective_sample_size"](log_weights)) < len(poses) / 2):
                poses = self._survivors(k, poses, weights, share, rng)
                log_weights = np.zeros(len(poses))
            if k:
                before, at = poses, drive.odometry[k] if k == carried else drive.odometry[k - 1]
                poses, said = self._moved(at, drive.odometry[k], poses, rng)
                log_weights = log_weights + said
                self._say("predict", k, poses, _normalised(log_weights), before=before)
            likelihood = self._log_likelihood(poses, k)
            log_weights = log_weights + TEMPER * likelihood
            if self.draws_random:
                average = float(np.exp(likelihood / len(drive.angles)).mean())
                slow, fast, share = map(_number, self.parts["random_share"](average, slow, fast, *RATES))
            self.counts.append(len(poses))
            self.shares.append(share)
            weights = _normalised(log_weights)
            mean, covariance = _mean(poses, weights)
            self._estimate = Estimate(drive.grid.to_map(mean), covariance)
            self._say("weigh", k, poses, weights)
            errors.append(float(np.hypot(*(mean - drive.truth[k])[:2])))
        return np.array(errors)

    def _survivors(self, k: int, poses: Array, weights: Array, share: float, rng: np.random.Generator) -> Array:
        self.resampled += 1
        teeth = copy.deepcopy(rng).uniform(0.0, 1.0 / len(weights)) + np.arange(len(weights)) / len(weights)
        chosen = np.asarray(self.parts["low_variance_sampler"](weights, rng)).astype(np.int64)
        # Another's function may draw its random number in another way: then nobody knows where its teeth stood.
        known = np.array_equal(np.searchsorted(np.cumsum(weights), teeth), np.sort(chosen))
        self._say("resample", k, poses, weights, ancestors=np.sort(chosen), teeth=teeth if known else None)
        kept = poses[chosen]
        if self.adapts:
            bins = len(np.unique(np.floor(kept / BIN).astype(int), axis=0))
            wanted = _number(self.parts["kld_particles"](bins, *KLD))
            count = int(np.clip(np.nan_to_num(wanted, nan=self.n), 30, self.n))
            kept = kept[rng.integers(len(kept), size=count)]
        if self.draws_random:
            fresh = rng.random(len(kept)) < share
            rows, columns = np.nonzero(self.drive.free)
            cell = rng.integers(len(rows), size=len(kept))
            places = (np.stack([columns[cell], rows[cell]], axis=1) + 0.5) * self.drive.grid.resolution
            anywhere = np.column_stack([places, rng.uniform(-np.pi, np.pi, len(kept))])
            kept = np.where(fresh[:, None], anywhere, kept)
        return kept

    def _moved(self, before: Array, now: Array, poses: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Where the particles are after the move, and what that adds to the logarithms of their weights."""
        if not self.weighs_moves:
            moved = self.parts["sample_motion_model_odometry"](before, now, poses, ALPHAS, rng)
            return np.asarray(moved, np.float64), np.zeros(len(poses))
        dx, dy = (now - before)[:2]
        trans, rot1 = np.hypot(dx, dy), wrap_angle(np.arctan2(dy, dx) - before[2])
        rot2 = wrap_angle(now[2] - before[2] - rot1)
        off = rng.uniform(-1.0, 1.0, (3, len(poses))) * np.array([[0.2], [0.15], [0.2]])
        heading = poses[:, 2] + rot1 + off[0]
        drive = np.maximum(trans + off[1], 0.01)
        xy = poses[:, :2] + drive[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
        moved = np.column_stack([xy, heading + rot2 + off[2]])
        density = self.parts["motion_model_odometry"](moved, poses, before, now, 3.0 * ALPHAS)
        return moved, np.log(np.maximum(np.nan_to_num(np.asarray(density, np.float64)), LEAST))

    def _log_likelihood(self, poses: Array, k: int) -> Array:
        """(n,) of scan k at every pose, untempered."""
        drive = self.drive
        if self.model == "field":
            model = self.parts["likelihood_field_range_finder_model"]
            told = (drive.ranges[k], drive.angles)
            held = (drive.laser, self._padded, drive.grid.resolution)
            p = np.array([model(*told, self._inside(pose), *held, *FIELD.values(), LONGEST) for pose in poses])
        else:
            true = drive.expected(poses) if self.model == "beam" else self._rays(poses)
            z = np.broadcast_to(drive.ranges[k], true.shape)
            parameters = (*BEAM.values(), LONGEST)
            p = self.parts["beam_range_finder_model"](z.ravel(), np.maximum(true, 0.01).ravel(), *parameters)
        found = np.asarray(p, np.float64).reshape(len(poses), -1)
        return np.log(np.maximum(np.nan_to_num(found), LEAST)).sum(axis=1)

    def _rays(self, poses: Array) -> Array:
        """(n, k) true ranges, by the part ``ray_cast``; rays that begin in a wall have none."""
        drive, cast = self.drive, self.parts["ray_cast"]
        true = np.zeros((len(poses), len(drive.angles)))
        for i, (x, y, yaw) in enumerate(poses):
            at_x = x + drive.laser[0] * np.cos(yaw) - drive.laser[1] * np.sin(yaw)
            at_y = y + drive.laser[0] * np.sin(yaw) + drive.laser[1] * np.cos(yaw)
            row, column = int(at_y // drive.grid.resolution), int(at_x // drive.grid.resolution)
            rows, columns = drive.occupied.shape
            if not (0 <= row < rows and 0 <= column < columns) or drive.occupied[row, column]:
                continue
            for b, angle in enumerate(yaw + drive.laser[2] + drive.angles):
                length = cast(drive.occupied, float(at_x), float(at_y), float(angle), drive.grid.resolution, LONGEST)
                true[i, b] = min(_number(length), LONGEST)
        return np.nan_to_num(true)

    @cached_property
    def _padded(self) -> Array:
        """The distances with a frame as wide as the laser sees, for beams that end outside of the map."""
        frame = int(LONGEST / self.drive.grid.resolution) + 10
        return np.pad(self.drive.distances, frame, constant_values=2.0)

    def _inside(self, pose: Array) -> Array:
        shift = (int(LONGEST / self.drive.grid.resolution) + 10) * self.drive.grid.resolution
        return pose + np.array([shift, shift, 0.0])

    def _say(
        self,
        kind: Kind,
        k: int,
        poses: Array,
        weights: Array,
        *,
        before: Array | None = None,
        ancestors: NDArray[np.int64] | None = None,
        teeth: Array | None = None,
    ) -> None:
        drive, grid = self.drive, self.drive.grid
        self.tell(
            SubStep(
                kind,
                int(drive.scans[k]),
                float(drive.times[k]),
                grid.to_map(poses).astype(np.float32),
                weights,
                None if before is None else grid.to_map(before).astype(np.float32),
                None if ancestors is None else ancestors.astype(np.int32),
                teeth,
                self._estimate,
            )
        )


def _number(found: Any) -> float:
    """What was returned, which may be an array of one number as well."""
    return float(np.asarray(found, np.float64).reshape(()))


def _normalised(log_weights: Array) -> Array:
    weights = np.exp(log_weights - log_weights.max())
    return np.asarray(weights / weights.sum())


def _mean(poses: Array, weights: Array) -> tuple[Array, Array]:
    """Weighted mean (3,) and covariance (3, 3)."""
    yaw = np.arctan2(weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2]))
    mean = np.array([*(weights @ poses[:, :2]), yaw])
    off = poses - mean
    off[:, 2] = wrap_angle(off[:, 2])
    return mean, (off * weights[:, None]).T @ off
