"""Recordings without odometry: where the laser is then, what is left out, and what stays an error."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from pipeline.errors import MclError
from pipeline.logs.columns import ScanColumns
from pipeline.logs.messages import Log, Trajectory
from pipeline.logs.reader import read_log
from pipeline.logs.recorded import Names
from pipeline.logs.writer import write_log
from pipeline.maps.occupancy_grid import OccupancyGrid
from recordings import UPRIGHT, Recording, link, ordinary, yaw

SECOND = 1_000_000_000
STAMPS = np.array([5, SECOND, 2 * SECOND])
GRID = OccupancyGrid(np.zeros((20, 60), np.float32), 0.1, (-3.0, 4.0, 0.0))
TRUTH = Trajectory(STAMPS, np.array([[0.0, 5.0, 0.0], [1.0, 5.0, 0.0], [1.0, 6.0, 1.5]]))


def scans_only() -> Recording:
    recording = ordinary()
    recording.entries = [entry for entry in recording.entries if "Odometry" not in entry[1]]
    return recording


def read(recording: Recording, tmp_path: Path, **names: str) -> Log:
    return read_log(recording.write(tmp_path / "a.mcap"), names=Names(**names))


def written(tmp_path: Path, grid: OccupancyGrid | None = GRID, truth: Trajectory | None = TRUTH) -> Path:
    path, ranges = tmp_path / "ours.mcap", np.full((3, 4), 2.0, np.float32)
    scans = ScanColumns(STAMPS, np.arange(3), ranges, -0.5, 0.25, 0.1, 10.0, "laser")
    write_log(path, scans, None, (0.3, -0.1, 0.2), grid=grid, ground_truth=truth)
    return path


def test_all_scans_are_read_and_the_odometry_is_zero(tmp_path: Path) -> None:
    log, whole = read(scans_only(), tmp_path), read_log(ordinary().write(tmp_path / "b.mcap"))
    assert (log.wheels, whole.wheels) == (False, True)
    np.testing.assert_array_equal(log.stamps, whole.stamps)
    np.testing.assert_array_equal(log.ranges, whole.ranges)
    np.testing.assert_array_equal(log.odometry, np.zeros((10, 3)))
    assert log.laser.time_increment == whole.laser.time_increment == 0.001
    assert (log.sweeps, log.turns) == (None, None)
    told = log.metadata["reader"]
    assert (told["odometry_topic"], told["scans_outside_odometry"]) == ("", "0")
    assert "laser_at_centre" not in told


def test_the_root_of_what_carries_the_laser_is_the_robots_centre(tmp_path: Path) -> None:
    log = read(scans_only(), tmp_path)
    assert log.metadata["reader"]["frames"] == "odom -> base_footprint -> hokuyo_link"
    assert log.laser.pose == pytest.approx((0.2, 0.0, 0.0))


def test_another_centre_may_be_chosen(tmp_path: Path) -> None:
    assert read(scans_only(), tmp_path, base_frame="camera").laser.pose == pytest.approx((0.1, 0.0, 0.0))
    with pytest.raises(MclError, match="no transform from 'body' to the laser 'hokuyo_link'"):
        read(scans_only(), tmp_path, base_frame="body")


@pytest.mark.parametrize("above", ["map", "world", "odom", "robot/odom"])
def test_what_holds_the_robot_is_not_part_of_it(tmp_path: Path, above: str) -> None:
    recording = scans_only()
    recording.transforms((above, "base_footprint", (7.0, 0.0, 0.0), yaw(1.0)))
    assert read(recording, tmp_path).laser.pose == pytest.approx((0.2, 0.0, 0.0))


def test_a_mount_that_is_repeated_on_tf(tmp_path: Path) -> None:
    recording = Recording()
    for i in range(4):
        link(recording, i * SECOND, "base", "laser", 0.3)
        link(recording, i * SECOND, "base", "left_wheel", 0.0, float(i))  # which turns, and carries no laser
        recording.scan(i * SECOND, [1.0, 2.0], frame="laser")
    log = read(recording, tmp_path)
    assert (log.wheels, log.laser.pose) == (False, pytest.approx((0.3, 0.0, 0.0)))


def test_without_any_transforms_the_laser_is_at_the_centre_and_that_is_told(tmp_path: Path) -> None:
    recording = Recording()
    for i in range(3):
        recording.scan(i * SECOND, [1.0, 2.0], frame="laser")
    log = read(recording, tmp_path)
    assert (log.wheels, log.laser.pose, len(log)) == (False, (0.0, 0.0, 0.0), 3)
    assert "no transform" in log.metadata["reader"]["laser_at_centre"]


def test_transforms_that_do_not_reach_the_laser_are_an_error(tmp_path: Path) -> None:
    recording = scans_only()
    for entry in ordinary().entries[:1]:
        recording.entries.remove(entry)
    recording.transforms(("base", "camera", (0.1, 0.0, 0.0), UPRIGHT))
    with pytest.raises(MclError, match="no transform from the robot to the laser 'hokuyo_link': it has base -> camera"):
        read(recording, tmp_path)
    assert read(recording, tmp_path, base_frame="hokuyo_link").laser.pose == (0.0, 0.0, 0.0)


def test_odometry_that_is_there_but_does_not_reach_the_laser_is_an_error(tmp_path: Path) -> None:
    recording = Recording()
    for i in range(3):
        link(recording, i * SECOND, "odom", "base", 0.1 * i)
        recording.scan(i * SECOND, [1.0, 2.0], frame="laser")
    with pytest.raises(MclError, match=r"no odometry .* it has odom -> base"):
        read(recording, tmp_path)


@pytest.mark.parametrize("names", [{"odom_topic": "/odom"}, {"odom_topic": "/tf_static"}, {"odom_frame": "wheels"}])
def test_odometry_that_was_asked_for_and_is_missing_is_an_error(tmp_path: Path, names: dict[str, str]) -> None:
    with pytest.raises(MclError, match=r"no topic /odom|no odometry"):
        read(scans_only(), tmp_path, **names)


def test_a_log_of_ours_reads_back(tmp_path: Path) -> None:
    log = read_log(written(tmp_path))
    assert (log.wheels, len(log)) == (False, 3)
    np.testing.assert_allclose(log.laser.pose, (0.3, -0.1, 0.2), atol=1e-12)
    assert log.grid is not None
    assert log.ground_truth is not None
    np.testing.assert_allclose(log.ground_truth.poses, TRUTH.poses, atol=1e-12)


def test_nothing_in_it_tells_of_odometry_and_the_robot_is_drawn_beside_the_map(tmp_path: Path) -> None:
    found: dict[str, list[object]] = {}
    with AnyReader([written(tmp_path)]) as reader:
        for connection, _, data in reader.messages():
            found.setdefault(connection.topic, []).append(reader.deserialize(data, connection.msgtype))
    assert not {"/odom", "/tf", "/laser_pose", "/view/path"} & set(found)
    (robot,) = found["/view/robot"]
    assert robot.header.frame_id == "base_link"  # type: ignore[attr-defined]
    places = {
        t.child_frame_id: t.transform.translation.x
        for message in found["/view/tf"]
        for t in message.transforms  # type: ignore[attr-defined]
    }
    assert set(places) == {"map", "base_link"}
    assert places["map"] == 0.0
    assert places["base_link"] > 3.0 + 5.0


def test_without_a_map_the_robot_needs_no_place(tmp_path: Path) -> None:
    with AnyReader([written(tmp_path, None, None)]) as reader:
        topics = set(reader.topics)
    assert topics == {"/scan", "/tf_static", "/view/robot"}


def test_stamps_need_no_odometry_to_be_in_order(tmp_path: Path) -> None:
    recording = Recording()
    for stamp in (3, 1, 2):
        recording.scan(stamp * SECOND, [float(stamp), math.inf], frame="laser")
    np.testing.assert_array_equal(read(recording, tmp_path).ranges[:, 0], [1.0, 2.0, 3.0])
