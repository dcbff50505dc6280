"""A laser in front and one behind, taken together: what they see is what one laser at the centre would see."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import buildings
import numpy as np
import pytest
from drives import read, remarks

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.geometry import compose
from pipeline.localization import localize
from pipeline.logs.messages import Log
from pipeline.simulate import simulate_log
from pipeline.simulate.sensors import true_ranges
from pipeline.simulate.simulation import Simulated
from pipeline.simulate.world import World, build_world
from recordings import UPRIGHT, UPSIDE_DOWN, Recording, yaw

FRONT, REAR = (0.3, 0.05, 0.0), (-0.25, 0.0, math.pi)
FIRST, STEP, BEAMS = -math.radians(100.0), math.radians(1.0), 201
LATE = 60_000_000
"""ns: by which the rear laser's scans are later."""
LASERS = "/front/scan,/rear/scan"


@pytest.fixture(scope="module")
def drive() -> Simulated:
    return simulate_log(buildings.room(), 1)


@pytest.fixture(scope="module")
def world() -> World:
    return build_world(buildings.room(), mapped=False)


def ranges(world: World, pose: np.ndarray, mount: tuple[float, float, float], angles: np.ndarray) -> np.ndarray:
    laser = compose(pose, np.array(mount))
    nobody, nothing = np.empty((0, 3)), np.zeros((len(angles), len(world.panes)), np.bool_)
    return true_ranges(world, nobody, laser[:2], laser[2] + angles, nothing)


def recording(drive: Simulated, world: World, *, flipped: bool = False) -> Recording:
    found, angles = Recording(), FIRST + STEP * np.arange(BEAMS)
    rear = UPSIDE_DOWN if flipped else yaw(math.pi)
    if flipped:  # rolled by half a turn, it looks ahead: its beams go round the other way
        mount, across = (REAR[0], REAR[1], 0.0), -angles
    else:
        mount, across = REAR, angles
    found.transforms(
        ("base_link", "front", (FRONT[0], FRONT[1], 0.2), UPRIGHT), ("base_link", "rear", (*REAR[:2], 0.2), rear)
    )
    for stamp, pose in zip(drive.odometry_stamps, drive.odometry, strict=True):
        found.odometry(int(stamp), *pose.tolist(), topic="/odom", frames=("odom", "base_link"))
    options = {"first": FIRST, "step": STEP, "limits": (0.05, 30.0), "time_increment": 0.0}
    for stamp in drive.log.stamps.tolist():
        now, later = drive.motion.at(np.array([stamp, stamp + LATE]) / 1e9)
        front, back = ranges(world, now, FRONT, angles), ranges(world, later, mount, across)
        found.scan(stamp, front.tolist(), frame="front", topic="/front/scan", **options)
        found.scan(stamp + LATE, back.tolist(), frame="rear", topic="/rear/scan", **options)
    return found


@pytest.fixture(scope="module")
def log(drive: Simulated, world: World, tmp_path_factory: pytest.TempPathFactory) -> Log:
    return read(recording(drive, world), tmp_path_factory.mktemp("two"), scan_topic=LASERS)


def test_the_scan_is_that_of_a_laser_at_the_centre(drive: Simulated, world: World, log: Log) -> None:
    assert log.laser.pose == pytest.approx((0.0, 0.0, 0.0))
    assert log.laser.beams == 360
    assert len(log) == len(drive.log)
    off = []
    for row in range(0, len(log), 7):
        pose = drive.motion.at(log.stamps[row : row + 1] / 1e9)[0]
        exact = ranges(world, pose, (0.0, 0.0, 0.0), log.laser.angles)
        off.append(np.abs(log.ranges[row] - exact))
    both = np.array(off)
    assert np.mean(np.isfinite(both)) > 0.9
    assert np.nanmedian(both) < 0.02
    assert np.nanpercentile(both, 85) < 0.15
    assert "are taken together, as one laser at 'base_link'" in remarks(log)


def test_the_robot_is_found_with_both(drive: Simulated, log: Log) -> None:
    found = localize(dataclasses.replace(log, grid=drive.log.grid), Config(max_particles=3000))
    end = drive.ground_truth.poses[-1]
    assert np.hypot(*(found.poses[-1] - end)[:2]) < 0.1


def test_a_laser_that_hangs_upside_down_is_put_right(drive: Simulated, world: World, tmp_path: Path) -> None:
    both = read(recording(drive, world, flipped=True), tmp_path, scan_topic=LASERS)
    pose = drive.motion.at(both.stamps[:1] / 1e9)[0]
    exact = ranges(world, pose, (0.0, 0.0, 0.0), both.laser.angles)
    assert np.nanmedian(np.abs(both.ranges[0] - exact)) < 0.02


def test_what_cannot_be_taken_together_is_refused(drive: Simulated, world: World, tmp_path: Path) -> None:
    both = recording(drive, world)
    with pytest.raises(MclError, match="no topic /back/scan"):
        read(both, tmp_path, scan_topic="/front/scan,/back/scan")
    with pytest.raises(MclError, match="--laser-pose and --laser-frame are of one laser"):
        read(both, tmp_path, scan_topic=LASERS, laser_pose=(0.0, 0.0, 0.0))
    one = read(both, tmp_path, scan_topic="/rear/scan")
    assert one.laser.beams == BEAMS
    assert one.laser.pose[2] == pytest.approx(math.pi)
