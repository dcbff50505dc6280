"""Numbers that no robot says are left out where messages enter, counted and named; never is one of them in a Log."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from drives import FRAMES, drive, moments, ordinary_drive, read, remarks, scan, steps

from pipeline.errors import MclError
from pipeline.logs.messages import Log
from recordings import UPRIGHT, Recording, header, pose, quaternion

NAN, INF = math.nan, math.inf


def with_odometry(wrong: dict[int, tuple[float, float, float]]) -> Recording:
    recording = Recording()
    for i, (recording, moment) in enumerate(drive()):
        recording.odometry(moment.stamp, *wrong.get(i, moment.pose), topic="/odom", frames=FRAMES)
        scan(recording, moment)
    return recording


def all_finite(log: Log) -> bool:
    laser = log.laser
    numbers = [*laser.pose, laser.angle_min, laser.angle_increment, laser.range_min, laser.range_max]
    columns = [log.odometry, *(c for c in (log.sweeps,) if c is not None)]
    return bool(np.isfinite(numbers).all()) and all(bool(np.isfinite(c).all()) for c in columns)


def test_odometry_of_uninitialised_memory(tmp_path: Path) -> None:
    base = read(ordinary_drive(), tmp_path)
    log = read(with_odometry({0: (1e256, 0.0, 0.0), 1: (1e256, 0.0, 0.0), 30: (NAN, 1.0, 0.0)}), tmp_path)
    assert all_finite(log)
    assert "/odom: 3 of 60 messages left out" in remarks(log)
    assert "message 1 has x = 1e+256, message 2 has x = 1e+256, message 31 has x = nan" in remarks(log)
    assert len(log) == len(base) - 2  # the scans before the first odometry that says anything
    np.testing.assert_allclose(np.delete(log.odometry, 28, 0), np.delete(base.odometry[2:], 28, 0), atol=1e-12)


@pytest.mark.parametrize("there", [(300.0, -40.0, 1.0), (5000.0, 0.0, 0.0)])
def test_a_message_from_elsewhere_and_back(tmp_path: Path, there: tuple[float, float, float]) -> None:
    base = read(ordinary_drive(), tmp_path)
    log = read(with_odometry({20: there}), tmp_path)
    assert "/odom: 1 of 60 messages left out" in remarks(log)
    np.testing.assert_allclose(np.delete(steps(log), [19, 20], 0), np.delete(steps(base), [19, 20], 0), atol=1e-9)
    assert np.abs(log.odometry[20] - base.odometry[20]).max() < 0.5  # between its neighbours


def test_only_nonsense_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(
        MclError, match=r"/odom: none of 60 messages says a pose that can be one: message 1 has x = nan"
    ):
        read(with_odometry(dict.fromkeys(range(60), (NAN, 0.0, 0.0))), tmp_path)


def test_quaternions_that_nobody_filled_in_and_others_that_are_not_of_length_one(tmp_path: Path) -> None:
    base = read(ordinary_drive(), tmp_path)
    recording = Recording()
    for i, (recording, moment) in enumerate(drive()):
        recording.odometry(moment.stamp, *moment.pose, topic="/odom", frames=FRAMES)
        scan(recording, moment)
        topic, kind, stamp, sequence, data = recording.entries[-2]
        q = np.frombuffer(data, "<f8", 4, offset=len(data) - 8 * (36 + 6 + 36 + 4))
        turned = q * (0.0 if i == 10 else 2.5 if i == 11 else 1e-9 if i == 12 else 1.0)
        start = len(data) - 8 * (36 + 6 + 36 + 4)
        recording.entries[-2] = (topic, kind, stamp, sequence, data[:start] + turned.tobytes() + data[start + 32 :])
    log = read(recording, tmp_path)
    assert "/odom: 2 of 60 messages left out" in remarks(log)
    assert "message 11 has a quaternion of length 0" in remarks(log)
    np.testing.assert_allclose(log.odometry[[9, 11, 13]], base.odometry[[9, 11, 13]], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "value"),
    [("first", NAN), ("first", 1e30), ("step", NAN), ("step", INF), ("step", 1e6)],
)
def test_a_scan_with_angles_that_are_none(tmp_path: Path, name: str, value: float) -> None:
    recording = Recording()
    for i, (recording, moment) in enumerate(drive()):
        recording.odometry(moment.stamp, *moment.pose, topic="/odom", frames=FRAMES)
        scan(recording, moment, **({name: value} if i == 7 else {}))
    log = read(recording, tmp_path)
    assert len(log) == 59
    assert "/scan: 1 of 60 messages left out: in message 8 angle_" in remarks(log)
    for recording, moment in drive():
        scan(recording, moment, **{name: value})
    with pytest.raises(MclError, match="/scan: no scan can be used: angle_"):
        read(recording, tmp_path)


@pytest.mark.parametrize("limits", [(NAN, 81.8), (0.0, NAN), (0.0, 1e30), (-INF, 81.8), (1e9, 81.8), (NAN, NAN)])
def test_limits_that_are_none(tmp_path: Path, limits: tuple[float, float]) -> None:
    recording = Recording()
    for recording, moment in drive():
        recording.odometry(moment.stamp, *moment.pose, topic="/odom", frames=FRAMES)
        scan(recording, moment, limits=limits)
    log = read(recording, tmp_path)
    base = read(ordinary_drive(), tmp_path)
    assert all_finite(log)
    assert 0.0 <= log.laser.range_min < 1.0
    assert log.laser.range_max < 100.0
    np.testing.assert_array_equal(np.isnan(log.ranges), np.isnan(base.ranges))


@pytest.mark.parametrize("mount", [(NAN, 0.0, 0.0), (1e9, 0.0, 0.0), (INF, 0.0, 0.0), (900.0, 0.0, 0.0)])
def test_a_mount_that_is_none(tmp_path: Path, mount: tuple[float, float, float]) -> None:
    with pytest.raises(MclError, match=r"none of 1 message says a pose|m from 'base_link'") as caught:
        read(ordinary_drive(mount=mount), tmp_path)
    assert "--laser-pose" in str(caught.value)
    log = read(ordinary_drive(mount=mount), tmp_path, laser_pose=(0.25, 0.0, 0.0))
    assert log.laser.pose == (0.25, 0.0, 0.0)


def test_a_transform_of_something_else_does_not_matter(tmp_path: Path) -> None:
    recording = ordinary_drive()
    recording.transforms(("base_link", "camera", (NAN, 0.0, 0.0), UPRIGHT))
    recording.transforms(("base_link", "arm", (0.0, 0.0, 0.0), (NAN, NAN, NAN, NAN)))
    log = read(recording, tmp_path)
    assert (len(log), remarks(log)) == (60, "")


def test_a_mount_without_a_quaternion_is_not_turned_and_said(tmp_path: Path) -> None:
    recording = Recording()
    recording.transforms(("base_link", "laser", (0.2, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)))
    for moment in moments():
        scan(recording, moment)
    log = read(recording, tmp_path)
    assert log.laser.pose == pytest.approx((0.2, 0.0, 0.0))
    assert "/tf_static, base_link -> laser: its quaternions are all zeros" in remarks(log)


def the_map(resolution: float = 0.1, x: float = 0.0, q: tuple[float, float, float, float] = UPRIGHT) -> Recording:
    from recordings import T, time

    recording = ordinary_drive()
    info = T["nav_msgs/msg/MapMetaData"](
        map_load_time=time(0), resolution=np.float32(resolution), width=2, height=1, origin=pose(x, 0.0, q)
    )
    message = T["nav_msgs/msg/OccupancyGrid"](header=header(0, "map"), info=info, data=np.zeros(2, np.int8))
    assert quaternion(q).x == q[0] or math.isnan(q[0])
    recording.put("/map", "nav_msgs/msg/OccupancyGrid", 0, message)
    return recording


@pytest.mark.parametrize("wrong", [{"resolution": NAN}, {"resolution": 0.0}, {"x": NAN}, {"x": 1e300}])
def test_a_map_that_lies_nowhere(tmp_path: Path, wrong: dict[str, float]) -> None:
    with pytest.raises(MclError, match=r"/map: its (resolution|origin) is") as caught:
        read(the_map(**wrong), tmp_path)
    assert "--map" in str(caught.value)


def test_a_map_whose_yaw_is_no_number(tmp_path: Path) -> None:
    log = read(the_map(q=(NAN, NAN, NAN, NAN)), tmp_path)
    assert log.grid is not None
    assert log.grid.origin == (0.0, 0.0, 0.0)
    assert "the yaw of its origin is no number: taken for 0" in remarks(log)


def test_a_robot_that_goes_nowhere_else_is_left_as_it_was(tmp_path: Path) -> None:
    assert remarks(read(ordinary_drive(), tmp_path)) == ""
