"""Recordings by other robots: what their topics and frames are called, what they leave out and what they get wrong."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from zstandard import ZstdCompressor

from pipeline.errors import MclError
from pipeline.geometry import compose
from pipeline.logs.reader import read_log
from pipeline.logs.recorded import Names
from pipeline.logs.transforms import to_quaternion
from recordings import UPRIGHT, UPSIDE_DOWN, Recording, link, ordinary, yaw

SECOND = 1_000_000_000


def without(recording: Recording, kind: str) -> Recording:
    recording.entries = [entry for entry in recording.entries if kind not in entry[1]]
    return recording


def driven_on_tf(odom: str = "odom") -> Recording:
    """No Odometry: odom -> base_footprint on /tf, a localization's map -> odom beside it."""
    recording = without(ordinary(), "Odometry")
    for i in range(21):
        stamp = SECOND + i * 50_000_000
        link(recording, stamp, "map", odom, 3.0 + 0.01 * i)
        link(recording, stamp, odom, "base_footprint", 0.1 * i)
    return recording


# --- topics


def test_a_topic_is_chosen_by_name(tmp_path: Path) -> None:
    recording = ordinary()
    recording.scan(int(1.5 * SECOND), [9.0] * 5, topic="/rear/scan")
    for i in range(21):
        recording.odometry(SECOND + i * 50_000_000, 0.0, 5.0, 0.0, topic="/fused/odometry")
    path = recording.write(tmp_path / "a.mcap")
    assert len(read_log(path)) == 10
    log = read_log(path, names=Names(scan_topic="/rear/scan", odom_topic="/fused/odometry"))
    assert (len(log), log.odometry[0, 1]) == (1, 5.0)
    assert log.metadata["reader"]["scan_topic"] == "/rear/scan"
    assert log.metadata["reader"]["odometry_topic"] == "/fused/odometry"


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (Names(scan_topic="/scan"), r"no topic /scan in this file: it has .*/base/scan_front \("),
        (Names(odom_topic="/odom"), r"no topic /odom in this file: it has .*/robot/odometry \("),
        (Names(scan_topic="/robot/odometry"), r"/robot/odometry has 21 messages of nav_msgs/msg/Odometry \(cdr\), not"),
        (Names(odom_topic="/base/scan_front"), r"not of nav_msgs/msg/Odometry or tf2_msgs/msg/TFMessage"),
        (
            Names(base_frame="body"),
            r"no transform from 'body' to the laser 'hokuyo_link': it has .*base_link -> camera",
        ),
        (Names(laser_frame="velodyne"), r"no transform from 'base_footprint' to the laser 'velodyne': it has "),
        (Names(odom_topic="/tf_static", odom_frame="wheels"), r"no odometry .*wheels -> hokuyo_link on /tf.* it has "),
    ],
)
def test_a_name_that_does_not_fit_gets_a_list_of_what_is_there(tmp_path: Path, names: Names, said: str) -> None:
    with pytest.raises(MclError, match=said) as caught:
        read_log(ordinary().write(tmp_path / "a.mcap"), names=names)
    assert str(caught.value).startswith(str(tmp_path / "a.mcap"))
    assert "\n" not in str(caught.value)


def test_a_simulators_truth_is_not_taken_for_odometry(tmp_path: Path) -> None:
    recording = ordinary()
    for i in range(50):
        recording.odometry(SECOND + i, 77.0, 0.0, 0.0, topic="/base_pose_ground_truth")
    path = recording.write(tmp_path / "a.mcap")
    assert read_log(path).metadata["reader"]["odometry_topic"] == "/robot/odometry"
    chosen = Names(odom_topic="/base_pose_ground_truth")
    with pytest.raises(MclError, match=r"no scan lies within the odometry's time span: scans from 1.010 to 1.910 s"):
        read_log(path, names=chosen)


def test_a_planners_costmap_is_not_the_map(tmp_path: Path) -> None:
    recording = ordinary()
    recording.grid(np.zeros((1, 1), np.int8), 0.05, 0.0, 0.0, 0.0)
    recording.entries[-1] = ("/local_costmap/costmap", *recording.entries[-1][1:])
    assert read_log(recording.write(tmp_path / "a.mcap")).grid is None


# --- frames


def test_odometry_that_travels_as_a_transform(tmp_path: Path) -> None:
    log = read_log(driven_on_tf().write(tmp_path / "a.mcap"))
    np.testing.assert_allclose(log.odometry, [[0.02 + 0.2 * i, 0.0, 0.0] for i in range(10)], atol=1e-9)
    np.testing.assert_allclose(log.laser.pose, (0.2, 0.0, 0.0), atol=1e-12)
    assert log.metadata["reader"]["odometry_topic"] == "/tf"
    assert log.metadata["reader"]["frames"] == "odom -> base_footprint -> hokuyo_link"


def test_a_transform_from_a_frame_of_another_name(tmp_path: Path) -> None:
    path = driven_on_tf("world").write(tmp_path / "a.mcap")
    with pytest.raises(MclError, match=r"no odometry .* it has .*map -> world.*world -> base_footprint \(--odom-topic"):
        read_log(path)  # two frames move, and neither is called odom
    log = read_log(path, names=Names(odom_frame="world"))
    np.testing.assert_allclose(log.odometry[:, 0], 0.02 + 0.2 * np.arange(10), atol=1e-9)


def test_transforms_instead_of_the_odometry_messages(tmp_path: Path) -> None:
    recording = driven_on_tf()
    recording.entries += [entry for entry in ordinary().entries if "Odometry" in entry[1]]
    for i in range(21):
        recording.odometry(SECOND + i * 50_000_000, 0.0, 0.0, 0.0, topic="/broken")
    path = recording.write(tmp_path / "a.mcap")
    assert read_log(path, names=Names(odom_topic="/broken")).odometry[9, 0] == 0.0
    assert read_log(path, names=Names(odom_topic="/tf")).odometry[9, 0] == pytest.approx(1.82)


def test_another_centre_of_the_robot(tmp_path: Path) -> None:
    """The odometry moves the front axle; the centre is half a metre behind it, turned."""
    recording = Recording()
    recording.transforms(("axle", "body", (-0.5, 0.0, 0.0), yaw(0.3)), ("body", "laser", (0.7, 0.1, 0.2), UPRIGHT))
    for i in range(3):
        recording.odometry(i * SECOND, 1.0 * i, 0.5, 0.2 * i, frames=("odom", "axle"))
        recording.scan(i * SECOND, [1.0, 2.0], frame="laser")
    path = recording.write(tmp_path / "a.mcap")
    axle, body = read_log(path), read_log(path, names=Names(base_frame="body"))
    np.testing.assert_allclose(body.laser.pose, (0.7, 0.1, 0.0), atol=1e-12)
    np.testing.assert_allclose(body.odometry, compose(axle.odometry, (-0.5, 0.0, 0.3)), atol=1e-12)
    np.testing.assert_allclose(  # either way the laser is where it is
        compose(body.odometry, body.laser.pose), compose(axle.odometry, axle.laser.pose), atol=1e-12
    )


def test_odometry_that_names_its_frame_wrongly_or_not_at_all(tmp_path: Path) -> None:
    for child in ("", "robot7/base"):
        recording = Recording()
        recording.transforms(("base_link", "laser", (0.3, 0.0, 0.0), UPRIGHT))
        recording.odometry(0, 0.0, 0.0, 0.0, frames=("odom", child))
        recording.scan(0, [1.0, 2.0], frame="laser")
        path = recording.write(tmp_path / "a.mcap")
        with pytest.raises(MclError, match=r"which frame it moves|no transform from 'robot7/base'"):
            read_log(path)
        assert read_log(path, names=Names(base_frame="base_link")).laser.pose == pytest.approx((0.3, 0, 0))


def test_odometry_without_a_frame_moves_what_hangs_from_odom(tmp_path: Path) -> None:
    recording = Recording()
    recording.transforms(("base_link", "laser", (0.3, 0.0, 0.0), UPRIGHT))
    link(recording, 0, "odom", "base_link", 0.0)
    recording.odometry(0, 0.0, 0.0, 0.0, frames=("odom", ""))
    recording.scan(0, [1.0, 2.0], frame="laser")
    log = read_log(recording.write(tmp_path / "a.mcap"))
    assert log.metadata["reader"]["frames"] == "odom -> base_link -> laser"


def test_a_laser_without_any_transform(tmp_path: Path) -> None:
    recording = without(ordinary(), "TFMessage")
    path = recording.write(tmp_path / "a.mcap")
    with pytest.raises(
        MclError, match=r"no transform from 'base_footprint' to the laser 'hokuyo_link': .*no transforms"
    ):
        read_log(path)
    assert read_log(path, names=Names(laser_frame="base_footprint")).laser.pose == (0.0, 0.0, 0.0)


def test_one_of_several_lasers_on_a_topic(tmp_path: Path) -> None:
    recording = ordinary()
    recording.transforms(("base_link", "rear_link", (-0.2, 0.0, 0.3), yaw(math.pi)))
    recording.scan(int(1.55 * SECOND), [7.0] * 5, frame="rear_link")
    path = recording.write(tmp_path / "a.mcap")
    with pytest.raises(MclError, match="--laser-frame takes one of them"):
        read_log(path)
    assert len(read_log(path, names=Names(laser_frame="hokuyo_link"))) == 10
    rear = read_log(path, names=Names(laser_frame="rear_link"))
    assert (len(rear), rear.laser.pose[0]) == (1, pytest.approx(-0.2))


def test_a_laser_that_moves_on_the_robot(tmp_path: Path) -> None:
    recording = ordinary()
    recording.scan(int(1.5 * SECOND), [1.0] * 5, frame="nodding", topic="/scan")
    for i in range(3):
        link(recording, SECOND + i, "base_link", "nodding", 0.1, 0.2 * i)
    path = recording.write(tmp_path / "a.mcap")
    with pytest.raises(MclError, match="'nodding' moves on the robot: base_link -> nodding"):
        read_log(path, names=Names(scan_topic="/scan"))
    assert read_log(path).metadata["reader"]["scan_topic"] == "/base/scan_front"  # of several the one that can serve


def test_transforms_below_a_namespace_and_slashes_before_frames(tmp_path: Path) -> None:
    recording = Recording()
    recording.transforms(("/r1/base", "/r1/laser", (0.4, 0.0, 0.0), UPRIGHT), topic="/r1/tf_static")
    recording.odometry(0, 0.0, 0.0, 0.0, frames=("/r1/odom", "/r1/base"))
    recording.scan(0, [1.0, 2.0], frame="r1/laser")
    assert read_log(recording.write(tmp_path / "a.mcap")).laser.pose == pytest.approx((0.4, 0, 0))


@pytest.mark.parametrize("q", [UPRIGHT, UPSIDE_DOWN, yaw(2.5), yaw(-3.1), (0.5, 0.5, 0.5, 0.5), (0.0, 1.0, 0.0, 0.0)])
def test_a_rotation_comes_back_as_its_quaternion(q: tuple[float, float, float, float]) -> None:
    x, y, z, w = q
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    assert abs(float(to_quaternion(matrix) @ np.array(q))) == pytest.approx(1.0, abs=1e-12)


# --- stamps


def test_stamps_out_of_order_repeated_and_with_gaps(tmp_path: Path) -> None:
    recording = Recording()
    for stamp, x in ((3.0, 3.0), (0.0, 0.0), (1.0, 1.0), (1.0, 1.0), (60.0, 9.0), (2.0, 2.0)):
        recording.odometry(int(stamp * SECOND), x, 0.0, 0.0, frames=("odom", "laser"))
    for stamp in (2.5, 0.5, 0.5, 59.0, 1.0):
        recording.scan(int(stamp * SECOND), [1.0, 2.0], frame="laser")
    log = read_log(recording.write(tmp_path / "a.mcap"))
    assert (log.times + 0.5).tolist() == [0.5, 0.5, 1.0, 2.5, 59.0]
    np.testing.assert_allclose(log.odometry[:, 0], [0.5, 0.5, 1.0, 2.5, 3.0 + 6.0 * 56 / 57])


def test_messages_that_nobody_stamped_happened_when_they_were_written_down(tmp_path: Path) -> None:
    recording = ordinary()
    unstamped = Recording()
    unstamped.transforms(("base_footprint", "hokuyo_link", (0.2, 0.0, 0.3), UPRIGHT))
    for i in range(21):
        unstamped.odometry(0, 0.1 * i, 0.0, 0.0)
    for i in range(10):
        unstamped.scan(0, [1.0, 2.0, 3.0, 4.0, 5.0 + i / 10])
    times = [entry[2] for entry in recording.entries]
    unstamped.entries = [
        (topic, kind, stamp, sequence, data)
        for (topic, kind, _, sequence, data), stamp in zip(unstamped.entries, times, strict=True)
    ]
    log = read_log(unstamped.write(tmp_path / "a.mcap"))
    np.testing.assert_allclose(log.odometry[:, 0], 0.02 + 0.2 * np.arange(10), atol=1e-9)


# --- beams


@pytest.mark.parametrize("beams", [1, 2, 37, 726, 2000])
@pytest.mark.parametrize("field", [0.5, 1.5 * math.pi, 2 * math.pi])
def test_any_field_of_view_and_number_of_beams(tmp_path: Path, beams: int, field: float) -> None:
    recording = Recording()
    recording.odometry(0, 0.0, 0.0, 0.0, frames=("odom", "laser"))
    ranges = np.linspace(1.0, 9.0, beams).tolist()
    recording.scan(0, ranges, first=-field / 2, step=field / beams, frame="laser")
    log = read_log(recording.write(tmp_path / "a.mcap"))
    assert log.laser.beams == beams
    np.testing.assert_allclose(log.laser.angles, -field / 2 + field / beams * np.arange(beams), atol=1e-4)
    np.testing.assert_allclose(log.ranges[0], ranges, rtol=1e-6)


def test_full_turns_that_begin_in_different_places(tmp_path: Path) -> None:
    """A laser that gives each turn as many beams as it got: the readings stay where they were measured."""
    recording = Recording()
    recording.odometry(0, 0.0, 0.0, 0.0, frames=("odom", "laser"))
    recording.odometry(9 * SECOND, 0.0, 0.0, 0.0, frames=("odom", "laser"))
    quarter = math.pi / 2
    for stamp in (1, 2, 3):
        recording.scan(stamp * SECOND, [1.0, 2.0, 3.0, 4.0], first=-math.pi, step=quarter, frame="laser")
    recording.scan(4 * SECOND, [3.0, 4.0, 1.0, 2.0], first=0.0, step=quarter, frame="laser")
    recording.scan(5 * SECOND, [1.0, 4.0, 3.0, 2.0], first=math.pi, step=-quarter, frame="laser")
    log = read_log(recording.write(tmp_path / "a.mcap"))
    np.testing.assert_array_equal(log.ranges, [[1.0, 2.0, 3.0, 4.0]] * 5)
    assert log.metadata["reader"]["scans_resampled"] == "2"


def test_a_simulators_longest_range_means_that_nothing_came_back(tmp_path: Path) -> None:
    recording = ordinary()
    for i in range(20):
        recording.scan(int(1.2 * SECOND) + i, [10.0, 10.0, 3.0, 4.0, 10.0])
    assert np.isinf(read_log(recording.write(tmp_path / "a.mcap")).ranges[5, [0, 1, 4]]).all()


def test_a_wall_at_the_longest_range_is_a_wall(tmp_path: Path) -> None:
    recording = ordinary()
    for i in range(20):
        recording.scan(int(1.2 * SECOND) + i, [10.0, 9.95, 9.93, 9.99, 9.97])
    assert np.isfinite(read_log(recording.write(tmp_path / "a.mcap")).ranges).all()


@pytest.mark.parametrize("limits", [(0.0, 0.0), (0.1, math.inf), (0.1, math.nan)])
def test_a_longest_range_that_was_never_filled_in_is_the_longest_reading(
    tmp_path: Path, limits: tuple[float, float]
) -> None:
    recording = Recording()
    recording.odometry(0, 0.0, 0.0, 0.0, frames=("odom", "laser"))
    recording.scan(0, [1.0, 7.5, math.inf, math.nan], limits=limits, frame="laser")
    log = read_log(recording.write(tmp_path / "a.mcap"))
    assert log.laser.range_max == 7.5
    np.testing.assert_array_equal(log.ranges[0], np.float32([1.0, 7.5, math.inf, math.nan]))


# --- containers


def test_messages_that_are_packed_one_by_one(tmp_path: Path) -> None:
    recording = ordinary()
    whole = read_log(recording.write(tmp_path / "a.mcap"))
    pack = ZstdCompressor().compress
    recording.entries = [(*entry[:4], pack(entry[4])) for entry in recording.entries]
    packed = read_log(recording.write(tmp_path / "b.mcap"))
    np.testing.assert_array_equal(packed.ranges, whole.ranges)
    np.testing.assert_array_equal(packed.odometry, whole.odometry)


def test_a_packed_file_and_a_bags_folder_say_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "a.mcap.zstd").write_bytes(ZstdCompressor().compress(b"anything"))
    with pytest.raises(MclError, match=r"packed with zstd.*mcl convert"):
        read_log(tmp_path / "a.mcap.zstd")
    with pytest.raises(MclError, match=r"a directory, not an .mcap .a bag.*mcl convert"):
        read_log(tmp_path)


@pytest.mark.parametrize("kind", ["chunks", "message"])
def test_real_recordings_however_they_are_packed(shared_data: Path, kind: str) -> None:
    plain = read_log(shared_data / "uob_pioneer" / "trace0_ros2_mcap" / "uob_trace0.mcap")
    (packed,) = (shared_data / "mcap_fixtures" / f"uob_trace0_zstd_{kind}").glob("*.mcap")
    log = read_log(packed)
    np.testing.assert_array_equal(log.ranges, plain.ranges)
    np.testing.assert_array_equal(log.odometry, plain.odometry)


def test_odometry_of_a_real_recording_from_its_transforms(shared_data: Path) -> None:
    path = shared_data / "uob_pioneer" / "trace0_ros2_mcap" / "uob_trace0.mcap"
    told, seen = read_log(path), read_log(path, names=Names(odom_topic="/tf"))
    assert seen.metadata["reader"]["frames"] == "odom -> base_link -> laser"
    np.testing.assert_allclose(seen.odometry, told.odometry[-len(seen) :], atol=1e-6)
