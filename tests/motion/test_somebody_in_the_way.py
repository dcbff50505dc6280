"""A scan or two that fit nothing, since somebody stands before the laser: the walls from before are found again."""

from __future__ import annotations

import dataclasses
import itertools

import buildings
import numpy as np
import pytest

from pipeline.config import Config
from pipeline.geometry import between
from pipeline.logs.messages import Log
from pipeline.motion.laser_odometry import PATIENCE
from pipeline.motion.witnesses import Motion, Witnesses
from pipeline.simulate import Simulated, simulate_log

SINCE = 40


@pytest.fixture(scope="module")
def drive() -> Simulated:
    return simulate_log(buildings.room(), 4)


def heard(log: Log) -> list[Motion]:
    witnesses = Witnesses(log.laser, Config())
    return [witnesses.update(scan) for scan in log.scans()]


def crowded(log: Log, scans: int) -> Log:
    """People all around the robot, who move: in so many scans no wall is seen."""
    ranges, rng = log.ranges.copy(), np.random.default_rng(1)
    for k in range(SINCE, SINCE + scans):
        legs = np.repeat(rng.uniform(0.4, 1.6, 20), len(log.laser.angles) // 20 + 1)[: log.laser.beams]
        ranges[k] = legs / np.maximum(np.cos(np.linspace(-0.4, 0.4, log.laser.beams) * 3 % 0.8), 0.5)
    return dataclasses.replace(log, ranges=ranges.astype(np.float32))


@pytest.mark.parametrize("scans", [1, 2])
def test_who_stands_in_the_way_for_a_moment_makes_no_gap(drive: Simulated, scans: int) -> None:
    motions = heard(crowded(drive.log, scans))
    during, after = motions[SINCE : SINCE + scans], motions[SINCE + scans :]
    assert all(motion.laser is not None and motion.laser.fit < 0.4 for motion in during)
    assert [motion.gap for motion in motions] == [None] * len(motions)
    # The walls are those from before: the way across is the wheels', and right; after it the laser follows again.
    first = after[0].laser
    assert first is not None
    assert first.blind
    assert first.fit > 0.6
    assert {motion.laser.stretch for motion in after if motion.laser is not None} == {first.stretch}
    poses = np.array([motion.laser_pose for motion in motions])
    truth = drive.ground_truth.poses
    off = between(between(truth[0], truth[-1]), between(poses[0], poses[-1]))
    assert np.hypot(off[0], off[1]) < 0.08
    assert abs(off[2]) < 0.03


def test_what_was_remembered_before_is_remembered_after(drive: Simulated) -> None:
    """Not only what has been seen since: most of the room's walls are known at once."""
    walls = []
    for log in (drive.log, crowded(drive.log, 1)):
        witnesses = Witnesses(log.laser, Config())
        for scan in itertools.islice(log.scans(), SINCE + 2):
            witnesses.update(scan)
        walls.append(witnesses.walls.shape[1])
    assert walls[1] > 0.8 * walls[0]


def test_who_is_carried_off_is_told_so_within_a_few_scans(drive: Simulated) -> None:
    """Other walls for good, while the wheels stand still."""
    there = simulate_log(buildings.office(people=[]), 3).log
    n = SINCE + 40
    ranges = np.concatenate([drive.log.ranges[:SINCE], there.ranges[60:100]])
    odometry = np.concatenate([drive.log.odometry[:SINCE], np.repeat(drive.log.odometry[SINCE - 1 : SINCE], 40, 0)])
    log = dataclasses.replace(
        drive.log, ranges=ranges, odometry=odometry, stamps=drive.log.stamps[:n], ground_truth=None
    )
    gaps = [motion.gap for motion in heard(log)]
    told = [k for k, gap in enumerate(gaps) if gap is not None]
    assert told
    assert SINCE <= told[0] <= SINCE + PATIENCE
    gap = gaps[told[0]]
    assert gap is not None
    assert gap.kind == "unmatched"
    assert not gap.driven
