from __future__ import annotations

import math
import random
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from pipeline.errors import MclError
from pipeline.logs.messages import Log
from pipeline.logs.reader import read_log
from pipeline.maps.occupancy_grid import OccupancyGrid
from recordings import UPRIGHT, UPSIDE_DOWN, Quaternion, Recording, ordinary, yaw

SECOND = 1_000_000_000


def placed(tmp_path: Path, *links: tuple[str, str, tuple[float, float, float], Quaternion], **scan: object) -> Log:
    """The log of a recording whose laser is placed by these transforms."""
    recording = Recording()
    recording.transforms(*links)
    recording.odometry(0, 0.0, 0.0, 0.0, frames=("odom", "base_link"))
    recording.scan(0, [1.0, 2.0, 3.0, 4.0], frame="laser", **scan)  # type: ignore[arg-type]
    return read_log(recording.write(tmp_path / "a.mcap"))


def test_a_recording_by_somebody_else(tmp_path: Path) -> None:
    path = ordinary().write(tmp_path / "theirs.mcap")
    log = read_log(path)
    assert (log.name, log.path, len(log.sha256)) == ("theirs", path, 64)
    assert len(log) == 10
    np.testing.assert_allclose(log.odometry, [[0.02 + 0.2 * i, 0.0, 0.0] for i in range(10)], atol=1e-9)
    np.testing.assert_allclose(log.laser.pose, (0.2, 0.0, 0.0), atol=1e-12)
    assert (log.laser.beams, log.laser.angle_min, log.laser.angle_increment) == (5, -0.5, 0.25)
    assert log.metadata["reader"]["scan_topic"] == "/base/scan_front"
    assert log.metadata["reader"]["odometry_topic"] == "/robot/odometry"
    assert log.metadata["reader"]["scans_outside_odometry"] == "0"
    assert log.grid is None
    assert log.ground_truth is None


def test_a_recording_without_summary_or_statistics(tmp_path: Path) -> None:
    assert len(read_log(ordinary().write(tmp_path / "a.mcap", summary=False))) == 10


def test_ranges_follow_rep_117(tmp_path: Path) -> None:
    recording = ordinary()
    recording.scan(int(1.5 * SECOND), [0.0, 0.05, math.nan, 10.5, math.inf])
    recording.scan(int(1.6 * SECOND), [-1.0, -math.inf, 0.1, 10.0, 5.0])
    ranges = read_log(recording.write(tmp_path / "a.mcap")).ranges
    nan, inf = math.nan, math.inf
    np.testing.assert_array_equal(ranges[5], np.float32([nan, nan, nan, inf, inf]))
    np.testing.assert_array_equal(ranges[7], np.float32([nan, nan, 0.1, 10.0, 5.0]))
    assert ranges.dtype == np.float32


def test_scans_come_in_the_order_of_their_stamps(tmp_path: Path) -> None:
    recording = ordinary()
    recording.entries.reverse()
    log = read_log(recording.write(tmp_path / "a.mcap"))
    assert (np.diff(log.stamps) > 0).all()
    np.testing.assert_allclose(log.ranges[:, 4], 5 + np.arange(10) / 10, rtol=1e-6)
    np.testing.assert_allclose(log.odometry[:, 0], 0.02 + 0.2 * np.arange(10), atol=1e-9)


def test_the_turn_between_two_odometry_messages_is_the_shortest(tmp_path: Path) -> None:
    recording = Recording()
    recording.odometry(0, 0.0, 0.0, 3.0, frames=("odom", "laser"))
    recording.odometry(SECOND, 1.0, 2.0, -3.0, frames=("odom", "laser"))
    recording.scan(SECOND // 4, [1.0, 2.0], frame="laser")
    recording.scan(SECOND * 3 // 4, [1.0, 2.0], frame="laser")
    odometry = read_log(recording.write(tmp_path / "a.mcap")).odometry
    quarter = (2 * math.pi - 6) / 4
    np.testing.assert_allclose(odometry, [[0.25, 0.5, 3 + quarter], [0.75, 1.5, -3 - quarter]], atol=1e-9)


def test_odometry_with_the_scans_own_stamp_is_taken_as_it_is(tmp_path: Path) -> None:
    recording = Recording()
    for stamp, x, sequence in ((0, 0.0, 1), (SECOND, 1.0, 2), (SECOND, 2.0, 3), (SECOND, 3.0, 4), (2 * SECOND, 7.0, 5)):
        recording.odometry(stamp, x, 0.0, 0.0, sequence=sequence, frames=("odom", "laser"))
    recording.scan(SECOND, [1.0, 2.0], frame="laser", sequence=3)
    recording.scan(SECOND, [1.0, 2.0], frame="laser", sequence=99)
    recording.scan(2 * SECOND, [1.0, 2.0], frame="laser", sequence=6)
    recording.scan(3 * SECOND // 2, [1.0, 2.0], frame="laser", sequence=7)
    odometry = read_log(recording.write(tmp_path / "a.mcap")).odometry
    assert odometry[:, 0].tolist() == [2.0, 3.0, 5.0, 7.0]


def test_scans_outside_the_odometry_are_left_out_and_counted(tmp_path: Path) -> None:
    recording = ordinary()
    for stamp in (0, SECOND - 1, 3 * SECOND):
        recording.scan(stamp, [1.0] * 5)
    log = read_log(recording.write(tmp_path / "a.mcap"))
    assert len(log) == 10
    assert log.metadata["reader"]["scans_outside_odometry"] == "3"


def test_no_scan_within_the_odometry(tmp_path: Path) -> None:
    recording = Recording()
    recording.odometry(0, 0.0, 0.0, 0.0, frames=("odom", "laser"))
    recording.scan(SECOND, [1.0, 2.0], frame="laser")
    with pytest.raises(MclError, match="no scan lies within"):
        read_log(recording.write(tmp_path / "a.mcap"))


def test_a_turned_laser(tmp_path: Path) -> None:
    log = placed(tmp_path, ("base_link", "laser", (0.1, -0.2, 0.5), yaw(math.pi / 2)))
    np.testing.assert_allclose(log.laser.pose, (0.1, -0.2, math.pi / 2), atol=1e-12)
    assert log.ranges.tolist() == [[1.0, 2.0, 3.0, 4.0]]


def test_a_laser_behind_several_links(tmp_path: Path) -> None:
    log = placed(
        tmp_path,
        ("odom", "base_footprint", (7.0, 7.0, 7.0), UPRIGHT),  # where the robot is, not how it is built
        ("base_footprint", "base_link", (0.0, 0.0, 0.1), UPRIGHT),
        ("base_footprint", "mast", (1.0, 0.0, 0.0), yaw(math.pi / 2)),
        ("/mast", "/laser", (1.0, 0.0, 0.0), UPRIGHT),
    )
    np.testing.assert_allclose(log.laser.pose, (1.0, 1.0, math.pi / 2), atol=1e-12)


def test_a_laser_upside_down_reads_as_if_it_stood_upright(tmp_path: Path) -> None:
    """Beam k of the upside-down laser points where beam n - 1 - k of an upright one would, mirrored about x."""
    log = placed(tmp_path, ("base_link", "laser", (0.3, 0.0, 0.1), UPSIDE_DOWN), first=-0.5, step=0.25)
    assert log.ranges.tolist() == [[4.0, 3.0, 2.0, 1.0]]
    np.testing.assert_allclose(log.laser.angles, [-0.25, 0.0, 0.25, 0.5], atol=1e-7)
    np.testing.assert_allclose(log.laser.pose, (0.3, 0.0, 0.0), atol=1e-12)


def test_a_laser_upside_down_and_turned(tmp_path: Path) -> None:
    """Rolled by pi, then turned by 30 degrees: the direction of every range, computed in three dimensions."""
    half = math.radians(30) / 2
    rotation = (math.cos(half), math.sin(half), 0.0, 0.0)  # yaw(30 deg) after roll(180 deg)
    log = placed(tmp_path, ("base_link", "laser", (0.0, 0.0, 0.0), rotation), first=-0.5, step=0.25)
    directions = dict(zip(log.ranges[0].tolist(), log.laser.angles + log.laser.pose[2], strict=True))
    for k, measured in enumerate([1.0, 2.0, 3.0, 4.0]):
        assert directions[measured] == pytest.approx(math.radians(30) - (-0.5 + 0.25 * k), abs=1e-6)


def test_a_laser_that_turns_clockwise(tmp_path: Path) -> None:
    log = placed(tmp_path, ("base_link", "laser", (0.0, 0.0, 0.0), UPRIGHT), first=0.5, step=-0.25)
    assert log.ranges.tolist() == [[4.0, 3.0, 2.0, 1.0]]
    np.testing.assert_allclose(log.laser.angles, [-0.25, 0.0, 0.25, 0.5], atol=1e-7)


def test_a_laser_on_its_side(tmp_path: Path) -> None:
    with pytest.raises(MclError, match="tilted by 90 degrees"):
        placed(tmp_path, ("base_link", "laser", (0.0, 0.0, 0.0), (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))))


def test_transforms_that_travel_on_tf(tmp_path: Path) -> None:
    recording = Recording()
    recording.odometry(0, 0.0, 0.0, 0.0, frames=("odom", "base_link"))
    recording.transforms(("odom", "base_link", (5.0, 5.0, 0.0), UPRIGHT), topic="/tf")
    recording.transforms(("base_link", "laser", (0.135, 0.0, 0.0), UPRIGHT), topic="/tf")
    recording.scan(0, [1.0, 2.0], frame="laser")
    assert read_log(recording.write(tmp_path / "a.mcap")).laser.pose == (0.135, 0.0, 0.0)


def test_a_laser_that_nothing_connects_to_the_robot(tmp_path: Path) -> None:
    with pytest.raises(
        MclError, match="no transform from 'base_link' to the laser 'laser': it has base_link -> camera"
    ):
        placed(tmp_path, ("base_link", "camera", (0.0, 0.0, 0.0), UPRIGHT))


def test_scans_whose_number_of_beams_changes(tmp_path: Path) -> None:
    recording = ordinary()
    recording.scan(int(1.55 * SECOND), [1.0, 2.0, 3.0, 4.0])
    recording.scan(int(1.65 * SECOND), [8.0, 9.0, 8.0], first=-0.25, step=0.25)
    ranges = read_log(recording.write(tmp_path / "a.mcap")).ranges
    np.testing.assert_array_equal(ranges[6], np.float32([1.0, 2.0, 3.0, 4.0, math.nan]))
    np.testing.assert_array_equal(ranges[8], np.float32([math.nan, 8.0, 9.0, 8.0, math.nan]))


def test_the_scans_of_two_lasers_on_one_topic(tmp_path: Path) -> None:
    recording = ordinary()
    recording.scan(2 * SECOND, [1.0] * 5, frame="rear_link")
    with pytest.raises(MclError, match="several lasers: hokuyo_link, rear_link"):
        read_log(recording.write(tmp_path / "a.mcap"))


def test_of_several_topics_the_contracts_own_and_then_the_busiest(tmp_path: Path) -> None:
    recording = ordinary()
    for i in range(11):
        recording.scan(SECOND + i, [9.0] * 5, topic="/rear/scan")
    assert read_log(recording.write(tmp_path / "a.mcap")).metadata["reader"]["scan_topic"] == "/rear/scan"
    recording.scan(SECOND, [9.0] * 5, topic="/scan")
    assert read_log(recording.write(tmp_path / "a.mcap")).metadata["reader"]["scan_topic"] == "/scan"


def test_maps_on_a_topic(tmp_path: Path) -> None:
    recording = ordinary()
    recording.grid(np.zeros((1, 1), np.int8), 0.05, 0.0, 0.0, 0.0, stamp=1)
    recording.grid(np.array([[-1, 0, 100], [50, 1, 99]], np.int8), 0.05, 1.0, -2.0, 0.5, stamp=2)
    path = recording.write(tmp_path / "a.mcap")
    grid = read_log(path).grid
    assert grid is not None
    np.testing.assert_allclose(grid.occupancy, [[math.nan, 0.0, 1.0], [0.5, 0.01, 0.99]], atol=1e-7)
    assert grid.resolution == 0.05
    np.testing.assert_allclose(grid.origin, (1.0, -2.0, 0.5), atol=1e-12)
    given = OccupancyGrid(np.zeros((2, 2), np.float32), 0.1)
    assert read_log(path, grid=given).grid is given


def test_what_is_missing_is_named_and_what_is_there_listed(tmp_path: Path) -> None:
    recording = ordinary()
    recording.entries = [entry for entry in recording.entries if "LaserScan" not in entry[1]]
    said = r"no laser scans .* it has /tf_static \(tf2_msgs/msg/TFMessage, 1\), /robot/odometry \(.*, 21\)"
    with pytest.raises(MclError, match=said):
        read_log(recording.write(tmp_path / "a.mcap"))
    with pytest.raises(MclError, match="no messages at all"):
        read_log(Recording().write(tmp_path / "a.mcap"))


def test_files_that_are_no_mcap(tmp_path: Path) -> None:
    contents = {"empty": b"", "text": b"O 1 2 3 4\n", "magic": b"\x89MCAP0\r\n"}
    said = {"empty": "empty", "text": "not an MCAP", "magic": "damaged|cut"}
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(MclError, match=said[name]) as caught:
            read_log(tmp_path / name)
        assert str(caught.value).startswith(str(tmp_path / name))
    with pytest.raises(MclError, match="no such file"):
        read_log(tmp_path / "missing.mcap")
    with pytest.raises(MclError, match="cannot be read"):
        read_log(tmp_path)


def test_a_file_cut_anywhere_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    whole = ordinary().write(tmp_path / "a.mcap").read_bytes()
    read, said = 0, []
    for length in range(9, len(whole), 97):
        (tmp_path / "cut.mcap").write_bytes(whole[:length])
        try:
            log = read_log(tmp_path / "cut.mcap")
        except MclError as error:  # cut within the only chunk
            said.append(str(error))
            continue
        assert len(log) == 10
        assert "in no whole chunk" in log.metadata["reader"]["remarks"]
        read += 1
    assert read > 0
    assert all("this MCAP file is cut" in text for text in said)


def test_a_damaged_file_is_refused_or_read(tmp_path: Path) -> None:
    whole = ordinary().write(tmp_path / "a.mcap").read_bytes()
    rng = random.Random(0)
    for _ in range(300):
        damaged = bytearray(whole)
        for _ in range(rng.choice([1, 3, 30])):
            damaged[rng.randrange(8, len(whole) - 8)] = rng.randrange(256)
        (tmp_path / "damaged.mcap").write_bytes(damaged)
        with suppress(MclError):
            read_log(tmp_path / "damaged.mcap")


def test_a_message_that_is_not_what_its_channel_says(tmp_path: Path) -> None:
    recording = ordinary()
    topic, kind, stamp, sequence, data = recording.entries[-1]
    recording.entries[-1] = (topic, kind, stamp, sequence, data[:20])
    with pytest.raises(MclError, match=r"a\.mcap: /base/scan_front: a message is no sensor_msgs/msg/LaserScan"):
        read_log(recording.write(tmp_path / "a.mcap"))


def test_a_message_of_ros_1_that_is_none(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros1", library="test")
        kind = writer.register_schema("sensor_msgs/LaserScan", "ros1msg", b"float32[] ranges")
        channel = writer.register_channel("/scan", "ros1", kind)
        writer.add_message(channel, log_time=0, publish_time=0, data=b"\0" * 8)
        writer.finish()
    with pytest.raises(MclError, match=r"/scan: a message is no sensor_msgs/LaserScan"):
        read_log(tmp_path / "a.mcap")


def test_reading_does_not_import_what_it_does_not_need() -> None:
    heavy = "('rerun', 'numba', 'rosbags', 'PIL')"
    program = f"import sys, pipeline.logs.reader; print(*[m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


@pytest.mark.parametrize(
    ("file", "scans", "laser"),
    [
        ("uob_pioneer/trace0_ros2_mcap/uob_trace0.mcap", 957, (0.135, 0.0, 0.0)),
        ("olin_mac/macfirst_floor_take_2_mcap/olin.mcap", 354, (0.00393584, 0.0, math.pi / 2)),
        ("mcap_fixtures/uob_trace0_zstd_chunks/uob_trace0_zstd.mcap", 957, (0.135, 0.0, 0.0)),
    ],
)
def test_real_recordings(shared_data: Path, file: str, scans: int, laser: tuple[float, float, float]) -> None:
    log = read_log(shared_data / file)
    assert len(log) == scans
    np.testing.assert_allclose(log.laser.pose, laser, atol=1e-9)
    assert np.isfinite(log.odometry).all()


def test_real_recordings_without_scans(shared_data: Path) -> None:
    with pytest.raises(MclError, match=r"no laser scans .* /chatter \(std_msgs/msg/String, 1324\)"):
        read_log(shared_data / "mcap_fixtures" / "rosbag2_multiple_files_0.mcap")
