"""Every lesson's function at work: on a piece of the embedded drive, in a small filter that is otherwise right."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.filter.step import Estimate
from pipeline.filter.substeps import Kind, SubStep
from pipeline.geometry import wrap_angle
from pipeline.lessons.drive import Drive, embedded_drive
from pipeline.lessons.exam import Array, Function
from pipeline.lessons.small_filter import ALPHAS, Filter

Tell = Callable[[SubStep], None]
Parts = Mapping[str, Function]

ROBOT_SEES, ROBOT_NOISE = 8.0, np.array([0.15, 0.03])
"""m: how far beacons are seen; m, rad: with which deviations."""


@dataclass(frozen=True)
class Outcome:
    """How a function did on the log: ``value`` is the less the better, ``text`` says in a clause what came out."""

    value: float
    text: str

    def as_good_as(self, other: Outcome) -> bool:
        """Whether it is hardly worse than another: chance decides about some centimetres, or a scan."""
        return bool(self.value <= 1.5 * other.value + 0.15)


def _late(errors: Array) -> float:
    """Mean over the second half."""
    return float(np.nan_to_num(errors[len(errors) // 2 :], nan=np.inf, posinf=np.inf).mean())


def _error(errors: Array, more: str = "") -> Outcome:
    late = _late(errors)
    return Outcome(
        late, f"the estimate is {late:.2f} m off in the mean over the last {len(errors) - len(errors) // 2} scans{more}"
    )


def _along(first: int, count: int, every: int, beams: int) -> Drive:
    return embedded_drive().part(slice(first, first + count * every, every), beams)


def _tracked(parts: Parts, tell: Tell) -> Outcome:
    mcl = Filter(_along(60, 24, 3, 10), parts, 250, tell=tell)
    return _error(mcl.run())


def _density(parts: Parts, tell: Tell) -> Outcome:
    mcl = Filter(_along(60, 24, 3, 10), parts, 400, weighs_moves=True, tell=tell)
    return _error(mcl.run())


def _field(parts: Parts, tell: Tell) -> Outcome:
    mcl = Filter(_along(60, 16, 3, 12), parts, 100, deviations=(0.3, 0.3, 0.15), model="field", tell=tell)
    return _error(mcl.run())


def _rays(parts: Parts, tell: Tell) -> Outcome:
    mcl = Filter(_along(60, 12, 4, 7), parts, 40, deviations=(0.25, 0.25, 0.1), model="rays", tell=tell)
    return _error(mcl.run())


def _resampled(parts: Parts, tell: Tell) -> Outcome:
    mcl = Filter(_along(60, 24, 3, 10), parts, 250, tell=tell)
    errors = mcl.run()
    return _error(errors, f", and particles are drawn anew {mcl.resampled} times in {len(errors)} scans")


def _adaptive(parts: Parts, tell: Tell) -> Outcome:
    mcl = Filter(_along(60, 24, 3, 10), parts, 1500, deviations=(1.0, 1.0, 0.4), adapts=True, tell=tell)
    return _error(mcl.run(), f", with {mcl.counts[0]:,} particles at the first scan and {mcl.counts[-1]:,} at the last")


def _carried(parts: Parts, tell: Tell) -> Outcome:
    """For twenty scans nothing happens; then the robot is elsewhere, and its wheels say that they stood still."""
    before, after = 20, 16
    scans = np.concatenate([60 + 2 * np.arange(before), 280 + 2 * np.arange(after)])
    mcl = Filter(embedded_drive().part(scans, 10), parts, 300, deviations=(0.2, 0.2, 0.1), draws_random=True, tell=tell)
    mcl.run(carried=before)
    shares = np.nan_to_num(np.array(mcl.shares), nan=1.0)
    many = shares >= 0.3
    since = int(np.argmax(many[before:])) if many[before:].any() else after
    false = int(np.count_nonzero(many[:before]))
    told = f"{since + 1} scans after" if many[before:].any() else "never after"
    return Outcome(
        float(since + false),
        f"three in ten particles are random {told} somebody carried the robot off, "
        f"and at {false} of the {before} scans before",
    )


def _gaussian(parts: Parts, tell: Tell) -> Outcome:
    """EKF localization by beacons, whose ranges and directions are made from the drive's truth, with noise."""
    drive, rng = _along(40, 60, 3, 2), np.random.default_rng([72])
    beacons = drive.truth[::12, :2] + np.array([1.5, -1.0]) * np.array([[1], [-1], [1], [-1], [1]])
    mean = drive.truth[0] + rng.standard_normal(3) * np.array([0.4, 0.4, 0.15])
    covariance = np.diag([0.4, 0.4, 0.15]) ** 2
    errors = []
    for k in range(len(drive)):
        if k:
            mean, covariance = _predicted(mean, covariance, drive.odometry[k - 1], drive.odometry[k])
            _gaussian_step(drive, k, "predict", mean, covariance, tell)
        for beacon in beacons:
            dx, dy = beacon - drive.truth[k, :2]
            z = (
                np.array([np.hypot(dx, dy), np.arctan2(dy, dx) - drive.truth[k, 2]])
                + rng.standard_normal(2) * ROBOT_NOISE
            )
            z[1] = wrap_angle(z[1])
            if np.hypot(dx, dy) < ROBOT_SEES:
                told = parts["ekf_update"](mean, covariance, z, beacon, ROBOT_NOISE)
                mean, covariance = np.asarray(told[0], np.float64), np.asarray(told[1], np.float64)
        _gaussian_step(drive, k, "weigh", mean, covariance, tell)
        errors.append(np.hypot(*(mean - drive.truth[k])[:2]))
    return _error(np.array(errors))


def _predicted(mean: Array, covariance: Array, before: Array, now: Array) -> tuple[Array, Array]:
    """The Gaussian after a move of the odometry: Table 7.2, lines 2 to 7, with the noise of Table 5.6."""
    dx, dy = (now - before)[:2]
    trans, rot1 = np.hypot(dx, dy), wrap_angle(np.arctan2(dy, dx) - before[2])
    rot2 = wrap_angle(now[2] - before[2] - rot1)
    heading = mean[2] + rot1
    c, s = np.cos(heading), np.sin(heading)
    by_pose = np.array([[1.0, 0.0, -trans * s], [0.0, 1.0, trans * c], [0.0, 0.0, 1.0]])
    by_noise = np.array([[-trans * s, c, 0.0], [trans * c, s, 0.0], [1.0, 0.0, 1.0]])
    a1, a2, a3, a4 = ALPHAS
    turns = rot1**2 + rot2**2
    noise = np.diag([a1 * rot1**2 + a2 * trans**2, a3 * trans**2 + a4 * turns, a1 * rot2**2 + a2 * trans**2])
    moved = mean + np.array([trans * c, trans * s, rot1 + rot2])
    return moved, by_pose @ covariance @ by_pose.T + by_noise @ noise @ by_noise.T


def _gaussian_step(drive: Drive, k: int, kind: Kind, mean: Array, covariance: Array, tell: Tell) -> None:
    nothing = np.empty((0, 3), np.float32)
    estimate = Estimate(drive.grid.to_map(mean), covariance)
    scan, time = int(drive.scans[k]), float(drive.times[k])
    tell(SubStep(kind, scan, time, nothing, np.empty(0), estimate=estimate))


def _cells(parts: Parts, tell: Tell) -> Outcome:
    """A grid over 7.5 m by 7.5 m about the drive, in cells of half a metre; the heading is taken from a compass."""
    drive = _along(60, 8, 5, 12)
    size, n = 0.5, 15
    corner = drive.truth[len(drive) // 2, :2] - size * n / 2
    row, column = np.divmod(np.arange(n * n), n)
    centres = corner + (np.stack([column, row], axis=1) + 0.5) * size
    belief = np.full(n * n, 1.0 / (n * n))
    errors = []
    for k in range(len(drive)):
        yaw = drive.truth[k, 2]
        poses = np.column_stack([centres, np.full(n * n, yaw)])
        moved = np.zeros(2)
        if k:
            turn = drive.truth[k - 1, 2] - drive.odometry[k - 1, 2]
            dx, dy = (drive.odometry[k] - drive.odometry[k - 1])[:2]
            moved = np.array([dx * np.cos(turn) - dy * np.sin(turn), dx * np.sin(turn) + dy * np.cos(turn)])
        squared = ((centres[:, None] - centres[None] - moved) ** 2).sum(axis=-1)
        motion = np.exp(-0.5 * squared / 0.3**2)
        motion /= np.maximum(motion.sum(axis=0), 1e-12)
        off = drive.ranges[k] - drive.expected(poses)
        likelihood = np.prod(0.7 * np.exp(-0.5 * (off / 0.5) ** 2) + 0.1, axis=1)
        cells, scan, time = drive.grid.to_map(poses).astype(np.float32), int(drive.scans[k]), float(drive.times[k])
        tell(SubStep("predict", scan, time, cells, motion @ belief, cells=True))
        belief = np.nan_to_num(np.asarray(parts["grid_localization"](belief, motion, likelihood), np.float64))
        weights = np.maximum(belief, 0.0) / max(float(np.maximum(belief, 0.0).sum()), 1e-300)
        best = centres[int(np.argmax(belief))]
        tell(SubStep("weigh", scan, time, cells, weights, cells=True))
        errors.append(np.hypot(*(best - drive.truth[k, :2])))
    return _error(np.array(errors))


RUNS: Mapping[str, Callable[[Parts, Tell], Outcome]] = {
    "4.4": _resampled,
    "5.5": _density,
    "5.6": _tracked,
    "6.1": _tracked,
    "6.3": _field,
    "7.2": _gaussian,
    "8.1": _cells,
    "8.3": _carried,
    "8.4": _adaptive,
    "ess": _resampled,
    "rays": _rays,
}
"""What is done with a lesson's function, by the lesson's name."""
