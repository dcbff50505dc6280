"""Which topics and frames are the robot's: tried before they are taken, and what was not used is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from drives import FRAMES, START, drive, moments, ordinary_drive, read, remarks, scan, steps

from converters import convert
from pipeline.errors import MclError
from recordings import STORE, UPRIGHT, Recording, T, header, link, yaw

SECOND = 1_000_000_000


def two_robots(prefix: tuple[str, str] = ("/robot1", "/robot2")) -> Recording:
    """Two robots in one file, whose frames have the same names; the second drives a bent way and has more scans."""
    both = Recording()
    one, two = ordinary_drive(prefix[0]), ordinary_drive(prefix[1], (-0.4, 0.1, 0.2), bend=0.1)
    scan(two, moments()[-1], moments()[-1].stamp, topic=f"{prefix[1]}/scan")
    both.entries = sorted([*one.entries, *two.entries], key=lambda entry: entry[2])
    return both


@pytest.mark.parametrize("prefix", [("/robot1", "/robot2"), ("/fleet/a", "/fleet/b"), ("", "/robot2")])
def test_everything_of_a_robot_comes_from_its_namespace(tmp_path: Path, prefix: tuple[str, str]) -> None:
    one, two = ordinary_drive(), ordinary_drive(mount=(-0.4, 0.1, 0.2), bend=0.1)
    for name, alone, mount in ((prefix[0], one, (0.25, 0.0, 0.0)), (prefix[1], two, (-0.4, 0.1, 0.0))):
        log = read(two_robots(prefix), tmp_path, scan_topic=f"{name}/scan")
        assert log.metadata["reader"]["odometry_topic"] == f"{name}/odom"
        assert log.laser.pose == pytest.approx(mount)
        np.testing.assert_allclose(log.odometry[:60], read(alone, tmp_path).odometry, atol=1e-12)


def test_the_other_robot_is_named(tmp_path: Path) -> None:
    log = read(two_robots(), tmp_path)
    assert log.metadata["reader"]["scan_topic"] == "/robot2/scan"
    assert "/robot2/scan is taken, and not /robot1/scan (60); --scan-topic takes another" in remarks(log)


def test_the_last_static_transform_counts(tmp_path: Path) -> None:
    recording = ordinary_drive()
    recording.transforms(("base_link", "laser", (0.35, 0.1, 0.3), yaw(0.2)))
    log = read(recording, tmp_path)
    assert log.laser.pose == pytest.approx((0.35, 0.1, 0.2))
    assert "/tf_static, base_link -> laser is said 2 times and differently: the last counts" in remarks(log)


def test_a_static_transform_from_another_parent_replaces_the_first(tmp_path: Path) -> None:
    recording = ordinary_drive()
    recording.transforms(
        ("base_link", "plate", (0.0, 0.0, 0.1), yaw(0.5)), ("plate", "laser", (0.1, 0.0, 0.0), UPRIGHT)
    )
    assert read(recording, tmp_path).laser.pose == pytest.approx((0.1 * np.cos(0.5), 0.1 * np.sin(0.5), 0.5))


def test_the_same_transform_again_is_not_worth_a_word(tmp_path: Path) -> None:
    recording = ordinary_drive()
    recording.transforms(("base_link", "laser", (0.25, 0.0, 0.3), UPRIGHT))
    assert remarks(read(recording, tmp_path)) == ""


def nodding() -> Recording:
    """A laser that is fixed, and one that nods, with twice as many messages."""
    recording = Recording()
    for recording, moment in drive():
        recording.odometry(moment.stamp, *moment.pose, topic="/odom", frames=FRAMES)
        scan(recording, moment, topic="/base_scan")
        for k in range(2):
            stamp = moment.stamp + k * 10_000_000
            link(recording, stamp, "base_link", "tilt", 0.1, 0.3 * ((stamp // 10_000_000) % 7))
            scan(recording, moment, stamp, topic="/tilt_scan", frame="tilt")
    return recording


def test_of_several_lasers_the_one_that_can_serve(tmp_path: Path) -> None:
    log = read(nodding(), tmp_path)
    assert log.metadata["reader"]["scan_topic"] == "/base_scan"
    assert "/tilt_scan was not taken: 'tilt' moves on the robot" in remarks(log)
    with pytest.raises(MclError, match="moves on the robot"):
        read(nodding(), tmp_path, scan_topic="/tilt_scan")


def dead(on_tf: bool = False, other: str = "", still: bool = False) -> Recording:
    recording = Recording()
    for recording, moment in drive():
        recording.odometry(moment.stamp, 0.0, 0.0, 0.0, topic="/odom", frames=FRAMES)
        if other:
            recording.odometry(moment.stamp, *moment.pose, topic=other, frames=FRAMES)
        if on_tf:
            x, _, angle = moment.pose
            link(recording, moment.stamp, "odom", "base_link", x, angle)
        scan(recording, moments()[0] if still else moment, moment.stamp)
    return recording


def test_odometry_that_nobody_fills_in_gives_way(tmp_path: Path) -> None:
    log = read(dead(on_tf=True), tmp_path)
    assert log.metadata["reader"]["odometry_topic"] == "/tf"
    assert "/odom never moves: /tf is taken instead" in remarks(log)
    log = read(dead(other="/wheels"), tmp_path)
    assert "/odom never moves: /wheels is taken instead" in remarks(log)
    np.testing.assert_allclose(steps(log), steps(read(ordinary_drive(), tmp_path)), atol=1e-12)


def test_dead_odometry_and_nothing_else(tmp_path: Path) -> None:
    log = read(dead(), tmp_path)
    assert not log.wheels
    assert log.laser.pose == pytest.approx((0.25, 0.0, 0.0))
    assert "/odom never moves, though the scans change: it is not used" in remarks(log)
    assert read(dead(), tmp_path, odom_topic="/odom").wheels
    standing = read(dead(still=True), tmp_path)
    assert (standing.wheels, remarks(standing)) == (True, "")


def test_a_base_with_a_clock_of_its_own(tmp_path: Path) -> None:
    recording, months = Recording(), 96 * 86_400 * SECOND
    for recording, moment in drive():
        recording.odometry(moment.stamp - months, *moment.pose, topic="/odom", frames=FRAMES)
        topic, kind, _, sequence, data = recording.entries[-1]
        recording.entries[-1] = (topic, kind, moment.stamp, sequence, data)  # when it was written down
        scan(recording, moment)
    with pytest.raises(MclError, match=r"no scan lies within .*--stamps log"):
        read(recording, tmp_path)
    with pytest.raises(MclError, match="no scan lies within"):  # not only when it is too late
        convert([tmp_path / "drive.mcap"], tmp_path / "out.mcap")
    log = read(recording, tmp_path, stamps="log")
    np.testing.assert_allclose(log.odometry, read(ordinary_drive(), tmp_path).odometry, atol=1e-12)


def test_a_recording_without_the_lasers_place(tmp_path: Path) -> None:
    recording = ordinary_drive()
    recording.entries = [entry for entry in recording.entries if entry[0] != "/tf_static"]
    with pytest.raises(MclError, match="--laser-pose X,Y,YAW says where it is"):
        read(recording, tmp_path)
    assert read(recording, tmp_path, laser_pose=(0.25, 0.1, 0.2)).laser.pose == pytest.approx((0.25, 0.1, 0.2))


def test_the_first_echo_of_several(tmp_path: Path) -> None:
    recording, kind = Recording(), "sensor_msgs/msg/MultiEchoLaserScan"
    echo = T["sensor_msgs/msg/LaserEcho"]
    for recording, moment in drive():
        recording.odometry(moment.stamp, *moment.pose, topic="/odom", frames=FRAMES)
        beams = [echo(np.array([r, r + 1.0][: 1 + i % 2], np.float32)) for i, r in enumerate(moment.ranges)]
        beams[3] = echo(np.array([], np.float32))
        f = np.float32
        message = T[kind](
            header(moment.stamp, "laser"), f(-np.pi / 2), f(np.pi / 2), f(np.radians(1.0)), f(0.0), f(0.1), f(0.0),
            f(81.8), beams, [],
        )  # fmt: skip
        recording.put("/echoes", kind, moment.stamp, message)
    log, base = read(recording, tmp_path), read(ordinary_drive(), tmp_path)
    np.testing.assert_array_equal(np.delete(log.ranges, 3, 1), np.delete(base.ranges, 3, 1))
    assert np.isnan(log.ranges[:, 3]).all()


def test_only_point_clouds(tmp_path: Path) -> None:
    recording, kind = Recording(), "sensor_msgs/msg/PointCloud2"
    cloud = T[kind](header(START, "lidar"), 1, 0, [], False, 12, 0, np.zeros(0, np.uint8), True)
    recording.put("/points", kind, START, cloud)
    with pytest.raises(MclError, match=r"no laser scans .*pointcloud_to_laserscan"):
        read(recording, tmp_path)


def test_an_mcap_with_messages_of_ros_1(tmp_path: Path) -> None:
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    from pipeline.logs.reader import read_log

    ros1 = get_typestore(Stores.ROS1_NOETIC)
    ros1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf/msg/tfMessage"))
    path = tmp_path / "ros1.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros1", library="somebody else")
        channels: dict[str, int] = {}
        for topic, kind, stamp, sequence, data in ordinary_drive().entries:
            own = kind.replace("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
            if topic not in channels:
                text = ros1.generate_msgdef(own)[0].encode()
                schema = writer.register_schema(own.replace("/msg/", "/"), "ros1msg", text)
                channels[topic] = writer.register_channel(topic, "ros1", schema)
            message = _with_counters(ros1, STORE.deserialize_cdr(data, kind))
            content = bytes(ros1.serialize_ros1(message, own))
            writer.add_message(channels[topic], log_time=stamp, publish_time=stamp, sequence=sequence, data=content)
        writer.finish()
    log, base = read_log(path), read(ordinary_drive(), tmp_path)
    np.testing.assert_array_equal(log.ranges, base.ranges)
    np.testing.assert_allclose(log.odometry, base.odometry, atol=1e-12)
    assert log.laser.pose == pytest.approx(base.laser.pose)


def _with_counters(ros1, message):
    """A message of ROS 2 with the counters in its headers that ROS 1 has."""
    for headed in (message, *getattr(message, "transforms", ())):
        if hasattr(headed, "header"):
            header = headed.header
            headed.header = ros1.types["std_msgs/msg/Header"](0, header.stamp, header.frame_id)
    return message
