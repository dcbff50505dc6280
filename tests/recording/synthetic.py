"""A small building, a log driven through it, and the steps that a filter could have made of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from pipeline.filter.step import Beams, Estimate, Event, Step
from pipeline.geometry import Pose, between, compose, wrap_angle
from pipeline.judgement.verdict import Verdict
from pipeline.logs.messages import Laser, Log, Trajectory
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.motion.laser_odometry import Match
from pipeline.motion.models import Component
from pipeline.motion.prior import AGREE, Prior
from pipeline.motion.witnesses import Motion

LASER = Laser((0.25, 0.0, 0.0), -np.pi / 2, np.pi / 180, beams=180, range_min=0.0, range_max=20.0)


def building(origin: Pose = (0.0, 0.0, 0.0)) -> OccupancyGrid:
    """24 m x 12 m at 0.1 m: two rows of rooms along a corridor, unknown outside; the left wall is thick."""
    cells = np.full((160, 280), np.nan, np.float32)
    cells[20:140, 20:260] = 0.02
    for row in (20, 70, 90, 139):
        cells[row : row + 1, 20:260] = 1.0
    for column in (20, 60, 110, 150, 200, 259):
        cells[20:71, column] = 1.0
        cells[90:140, column] = 1.0
    cells[20:140, 20:26] = 1.0
    cells[20:140, 259] = 1.0
    for column in (35, 80, 125, 170, 225):
        cells[70, column : column + 10] = 0.02
        cells[90, column + 3 : column + 13] = 0.02
    return OccupancyGrid(cells, 0.1, origin)


def drive(
    scans: int, *, origin: Pose = (0.0, 0.0, 0.0), truth: bool = True, start: int = 1_600_000_000_123_456_789
) -> Log:
    """Along the corridor and back, a scan every 0.2 s; stamps are epoch nanoseconds, which float64 cannot hold."""
    grid = building(origin)
    phase = np.linspace(0, 2 * np.pi, scans, endpoint=False)
    x = 14.0 - 10.0 * np.cos(phase)
    y = 8.0 + 0.5 * np.sin(2 * phase)
    yaw = np.unwrap(np.arctan2(np.gradient(y), np.gradient(x)))
    poses = grid.to_map(np.stack([x, y, yaw], axis=-1))
    stamps = start + np.arange(scans, dtype=np.int64) * 200_000_001
    rng = np.random.default_rng(0)
    ranges = rng.uniform(0.5, 6.0, (scans, LASER.beams)).astype(np.float32)
    known = Trajectory(stamps, poses) if truth else None
    odometry = poses + np.array([3.0, -2.0, 0.0])
    return Log("synthetic", Path("synthetic.mcap"), "0" * 64, LASER, stamps, odometry, ranges, grid, known)


def steps(log: Log, count: int, *, beams: int = 36, seed: int = 0) -> Iterator[Step]:
    """Lost over the building, then two hypotheses, then one: `count` particles at every scan."""
    assert log.grid is not None
    rng = np.random.default_rng(seed)
    truth = log.grid.to_grid(log.odometry - [3.0, -2.0, 0.0])
    chosen = np.linspace(0, LASER.beams - 1, beams).astype(int)
    angles = LASER.angles[chosen]
    for scan in log.scans():
        progress = scan.index / max(len(log) - 1, 1)
        here = truth[scan.index]
        there = np.array([28.0 - here[0], 16.0 - here[1], wrap_angle(here[2] + np.pi)])
        if progress < 0.08:
            particles = rng.uniform([2.6, 2.1, -np.pi], [25.9, 13.9, np.pi], (count, 3))
            spread = 3.0
        else:
            share = 0.4 if progress < 0.3 else 0.0
            at_other = rng.random(count) < share
            particles = np.where(at_other[:, None], there, here) + rng.normal(size=(count, 3)) * [0.25, 0.12, 0.08]
            spread = 0.7
        particles[:, 2] = wrap_angle(particles[:, 2])
        log_weights = rng.normal(0, spread, count)
        log_weights -= np.logaddexp.reduce(log_weights)
        weights = np.exp(log_weights)
        covariance = np.diag([0.25, 0.12, 0.08]) ** 2 if progress >= 0.08 else np.diag([40.0, 9.0, 3.0])
        pose = log.grid.to_map(here + rng.normal(size=3) * 0.02) if progress >= 0.08 else log.grid.to_map([14, 8, 0.0])
        estimate = Estimate(pose, covariance, 1.0 if progress > 0.3 else 0.6)
        other = Estimate(log.grid.to_map(there), covariance, 0.4)
        clusters = (estimate, other) if 0.08 <= progress <= 0.3 else (estimate,)
        expected = np.clip(np.abs(1.0 / np.maximum(np.abs(np.sin(angles)), 0.1)), 0, 6).astype(np.float32)
        measured = expected + rng.normal(0, 0.1, beams).astype(np.float32)
        measured[5], measured[6] = np.inf, np.nan
        events = (
            (Event("started", f"{count} particles over the free space"),) if scan.index == 0
            else (Event("converged", "One hypothesis is left"),) if scan.index == int(0.3 * len(log)) + 1
            else (Event("lost", "The map explains 40 % of the beams", "WARN"),) if scan.index == int(0.7 * len(log))
            else ()
        )  # fmt: skip
        yield Step(
            index=scan.index,
            stamp=scan.stamp,
            time=scan.time,
            particles=log.grid.to_map(particles).astype(np.float32),
            log_weights=log_weights,
            estimate=estimate,
            clusters=clusters,
            beams=Beams(compose(pose, LASER.pose), angles, measured, expected),
            ess=float(1 / np.sum(weights**2)),
            mean_likelihood=float(0.2 + 0.6 * progress),
            explained=float(0.5 + 0.4 * progress),
            spread=float(np.hypot(*particles[:, :2].std(axis=0))),
            moved=True,
            resampled=scan.index % 3 == 0,
            motion=Motion(scan.time, scan.odometry, None, None, scan.odometry, scan.ranges),
            verdict=Verdict("found" if progress > 0.3 else "lost", float(progress > 0.3)),
            events=events,
        )


def heard(
    log: Log, seen: Iterable[Step], *, reversed_in: range = range(0), wheels: bool = True, every: int = 4
) -> Iterator[Step]:
    """The same steps with a laser's odometry, which is right; the wheels count backwards in some scans.

    Of the walls, another is remembered at every so many scans; nine of ten follow the laser, and the robot stands still
    in the last scan.
    """
    by_wheels, before = log.odometry[0], log.odometry[0]
    rng = np.random.default_rng(1)
    walls = np.empty((4, 0), np.float32)
    for step in seen:
        k, now = step.index, log.odometry[step.index]
        moved = between(before, now)
        by_wheels = compose(by_wheels, moved * [-1.0, -1.0, 1.0] if k in reversed_in else moved)
        pose = between(log.odometry[0], now)
        match = Match(pose, 1e-4 * np.eye(3), 0.9, 0.3 if k in reversed_in else 0.8, None, False, 0)
        if k % every == 0:
            places = compose(pose, rng.uniform([-12, -12, 0], [12, 12, 0], (900, 3)))[:, :2]
            walls = np.concatenate(
                [walls[:, -2700:], np.concatenate([places.T, 0 * places.T])], axis=1, dtype=np.float32
            )
        share = 0.5 if k in reversed_in else 0.8
        parts = [Component("laser", moved, 1e-4 * np.eye(3), share)]
        parts.append(Component("wheels" if wheels else "unseen", moved, 1e-2 * np.eye(3), 1.0 - share))
        disagreement = (4.0 if k in reversed_in else 0.25) * AGREE if wheels else np.nan
        still = k in (0, len(log) - 1)
        yield dataclasses.replace(
            step,
            motion=Motion(step.time, by_wheels if wheels else None, match, None, now, step.motion.ranges),
            prior=None if still else Prior(tuple(parts), disagreement),
            followed=None if still else np.array([0.9, 0.1]),
            walls=walls,
        )
        before = now
