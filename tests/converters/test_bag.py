"""Bags of ROS 1 and ROS 2: written here by rosbags, and where they are here, those of two real robots."""

from __future__ import annotations

import json
import math
import random
import sqlite3
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from converters import convert
from pipeline.errors import MclError
from pipeline.geometry import compose
from pipeline.logs import schema
from pipeline.logs.messages import Log
from pipeline.logs.reader import read_log
from pipeline.logs.recorded import Names
from recordings import STORE, UPRIGHT, UPSIDE_DOWN, Recording, T, header, ordinary, pose, quaternion, vector, yaw

SECOND = 1_000_000_000
TF = "tf2_msgs/msg/TFMessage"
SEQ = "std_msgs/msg/Header"


def ros1_store():
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    return store


def as_ros1(message: object, store: object) -> object:
    """The same message with ROS 1's header, which counts."""
    for name in getattr(message, "__dataclass_fields__", {}):
        value = getattr(message, name)
        if name == "header":
            object.__setattr__(message, name, store.types[SEQ](seq=7, stamp=value.stamp, frame_id=value.frame_id))
        elif isinstance(value, list):
            for item in value:
                as_ros1(item, store)
    return message


def ros1(recording: Recording, path: Path, transforms: str = TF) -> Path:
    store = ros1_store()
    if transforms != TF:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", transforms))
    with Writer1(path) as writer:
        connections = {}
        for topic, kind, stamp, _, data in recording.entries:
            message = as_ros1(STORE.deserialize_cdr(data, kind), store)
            name = transforms if kind == TF else kind
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            writer.write(connections[topic], stamp, store.serialize_ros1(message, name))
    return path


def ros2(recording: Recording, path: Path, plugin: StoragePlugin, mode: CompressionMode | None = None) -> Path:
    writer = Writer2(path, version=9, storage_plugin=plugin)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, kind, stamp, _, data in recording.entries:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], stamp, data)
    return path


def link(recording: Recording, stamp: int, parent: str, child: str, x: float, y: float, angle: float) -> None:
    stamped = T["geometry_msgs/msg/TransformStamped"](
        header=header(stamp, parent),
        child_frame_id=child,
        transform=T["geometry_msgs/msg/Transform"](translation=vector(x, y, 0.0), rotation=quaternion(yaw(angle))),
    )
    recording.put("/tf", TF, stamp, T[TF](transforms=[stamped]))


def driven() -> Recording:
    """As ``ordinary``, with a map, a localization's poses, and its map -> odom."""
    recording = ordinary()
    recording.grid(np.array([[0, 100], [-1, 50]], np.int8), 0.05, 1.0, -2.0, 0.5)
    amcl = "geometry_msgs/msg/PoseWithCovarianceStamped"
    for i in range(3):
        at = T["geometry_msgs/msg/PoseWithCovariance"](pose=pose(5.0 + i, 6.0, yaw(0.5)), covariance=np.zeros(36))
        stamp = (1 + i) * SECOND
        recording.put("/amcl_pose", amcl, stamp, T[amcl](header=header(stamp, "map"), pose=at))
    for i in range(2):
        link(recording, SECOND + i * SECOND // 2, "map", "odom_combined", 10.0 + i, 3.0, math.pi / 2)
    return recording


def converted(source: Path, tmp_path: Path, **options) -> Log:
    convert([source], tmp_path / "out.mcap", **options)
    return read_log(tmp_path / "out.mcap")


def same(log: Log, other: Log) -> None:
    np.testing.assert_array_equal(log.stamps, other.stamps)
    np.testing.assert_array_equal(log.ranges, other.ranges)
    np.testing.assert_allclose(log.odometry, other.odometry, atol=1e-12)
    assert log.laser.angles.tolist() == other.laser.angles.tolist()
    np.testing.assert_allclose(log.laser.pose, other.laser.pose, atol=1e-12)


@pytest.mark.parametrize(
    "kind", ["ros1", "ros1 of old", "sqlite3", "db3", "mcap", "bare mcap", "packed messages", "packed file"]
)
def test_every_kind_of_bag_reads_as_the_recording_itself(tmp_path: Path, kind: str) -> None:
    recording, mcap, sqlite = ordinary(), StoragePlugin.MCAP, StoragePlugin.SQLITE3
    theirs = recording.write(tmp_path / "theirs.mcap")
    bag = tmp_path / ("a.bag" if kind.startswith("ros1") else "bag")
    source = {
        "ros1": lambda: ros1(recording, bag),
        "ros1 of old": lambda: ros1(recording, bag, "tf/msg/tfMessage"),
        "sqlite3": lambda: ros2(recording, bag, sqlite),
        "db3": lambda: ros2(recording, bag, sqlite) / "bag.db3",
        "mcap": lambda: ros2(recording, bag, mcap),
        "bare mcap": lambda: theirs,
        "packed messages": lambda: ros2(recording, bag, mcap, CompressionMode.MESSAGE),
        "packed file": lambda: ros2(recording, bag, mcap, CompressionMode.FILE),
    }[kind]()
    log = converted(source, tmp_path)
    same(log, read_log(theirs))
    record = log.metadata[schema.SOURCE]
    assert (record["format"], record["scan_topic"]) == ("rosbag", "/base/scan_front")
    assert record["frames"] == "odom_combined -> base_footprint -> hokuyo_link"
    assert len(json.loads(record["sha256"])) == (2 if source.is_dir() else 1)
    assert log.ground_truth is None


def test_the_report_counts_messages(tmp_path: Path) -> None:
    report = convert([ros1(ordinary(), tmp_path / "a.bag")], tmp_path / "a.mcap")
    assert (report.format, report.unit, report.lines) == ("rosbag", "messages", 31)
    assert (report.scans, report.odometry, report.dropped) == (10, 21, 0)
    assert report.duration == pytest.approx(1.0)


def test_a_laser_upside_down_stays_so(tmp_path: Path) -> None:
    recording = Recording()
    recording.transforms(("base_link", "laser", (0.3, 0.1, 0.4), UPSIDE_DOWN))
    recording.odometry(0, 0.0, 0.0, 0.0, frames=("odom", "base_link"))
    recording.scan(0, [1.0, 2.0, 3.0], frame="laser")
    theirs = recording.write(tmp_path / "theirs.mcap")
    same(converted(theirs, tmp_path), read_log(theirs))
    assert read_log(tmp_path / "out.mcap").ranges.tolist() == [[3.0, 2.0, 1.0]]


def test_topics_and_frames_are_chosen(tmp_path: Path) -> None:
    recording = ordinary()
    recording.scan(int(1.5 * SECOND), [9.0] * 5, topic="/rear", frame="camera")
    source = ros1(recording, tmp_path / "a.bag")
    log = converted(source, tmp_path, names=Names(scan_topic="/rear"))
    assert (len(log), log.laser.pose[0]) == (1, pytest.approx(0.1))
    with pytest.raises(MclError, match=r"a\.bag: no topic /front in this file: it has .*/rear \("):
        convert([source], tmp_path / "b.mcap", names=Names(scan_topic="/front"))


def test_the_bags_own_map_travels_along_unless_another_is_given(tmp_path: Path) -> None:
    from pipeline.maps.map_server import save_map
    from pipeline.maps.occupancy_grid import OccupancyGrid

    source = ros1(driven(), tmp_path / "a.bag")
    grid = converted(source, tmp_path).grid
    assert grid is not None
    np.testing.assert_array_equal(grid.occupancy, np.float32([[0, 1], [np.nan, 0.5]]))
    np.testing.assert_allclose(grid.origin, (1.0, -2.0, 0.5))
    save_map(OccupancyGrid(np.zeros((3, 3), np.float32), 0.1), tmp_path / "m.yaml")
    given = converted(source, tmp_path, map_path=tmp_path / "m.yaml").grid
    assert given is not None
    assert given.width == 3


def test_a_localizations_poses_are_the_truth_only_on_request(tmp_path: Path) -> None:
    source = ros2(driven(), tmp_path / "bag", StoragePlugin.SQLITE3)
    assert converted(source, tmp_path).ground_truth is None
    truth = converted(source, tmp_path, ground_truth=Path("/amcl_pose")).ground_truth
    assert truth is not None
    np.testing.assert_allclose(truth.poses, [[5, 6, 0.5], [6, 6, 0.5], [7, 6, 0.5]])
    assert read_log(tmp_path / "out.mcap").metadata[schema.SOURCE]["ground_truth_from"] == "/amcl_pose"


def test_transforms_from_the_map_are_a_truth(tmp_path: Path) -> None:
    truth = converted(driven().write(tmp_path / "theirs.mcap"), tmp_path, ground_truth=Path("/tf")).ground_truth
    assert truth is not None
    odometry = [(0.1 * i, 0.0, 0.0) for i in range(21)]
    expected = [compose((10.0 + (i >= 10), 3.0, math.pi / 2), at) for i, at in enumerate(odometry)]
    np.testing.assert_allclose(truth.poses, expected, atol=1e-9)
    assert truth.stamps[0] == SECOND


def test_a_truth_in_a_file(tmp_path: Path) -> None:
    (tmp_path / "t.tum").write_text("1.5 1 2 0 0 0 0 1\n")
    truth = converted(ros1(driven(), tmp_path / "a.bag"), tmp_path, ground_truth=tmp_path / "t.tum").ground_truth
    assert truth is not None
    assert truth.poses.tolist() == [[1, 2, 0]]


@pytest.mark.parametrize(
    ("topic", "said"),
    [
        ("/nosuch", r"a\.bag: no topic /nosuch in this file: it has .*/amcl_pose"),
        ("/base/scan_front", r"a\.bag: /base/scan_front \(sensor_msgs/msg/LaserScan, 10\) says no poses"),
        ("nosuch.tum", r"nosuch\.tum: no such file"),
    ],
)
def test_a_truth_that_is_not_there(tmp_path: Path, topic: str, said: str) -> None:
    with pytest.raises(MclError, match=said):
        convert([ros1(driven(), tmp_path / "a.bag")], tmp_path / "a.mcap", ground_truth=Path(topic))
    assert not (tmp_path / "a.mcap").exists()


def test_no_transform_from_a_map(tmp_path: Path) -> None:
    recording = ordinary()
    link(recording, SECOND, "odom_combined", "base_footprint", 0.0, 0.0, 0.0)
    with pytest.raises(MclError, match=r"no transform from a map to 'odom_combined': it has .*base_link -> camera"):
        converted(recording.write(tmp_path / "a.mcap"), tmp_path, ground_truth=Path("/tf"))


def test_dropping_messages_is_a_kidnapping(tmp_path: Path) -> None:
    recording = Recording()
    recording.transforms(("base_link", "laser", (0.2, 0.0, 0.0), UPRIGHT))
    for i in range(20):
        recording.odometry(i * SECOND, 1.0 * i, 0.0, 0.5 * (i >= 10), frames=("odom", "base_link"))
    for i in range(19):
        recording.scan(i * SECOND + SECOND // 2, [1.0, 2.0], frame="laser")
    source = recording.write(tmp_path / "a.mcap")
    log = converted(source, tmp_path, drop=[(5.0, 12.9)])
    assert len(log) == 11
    assert json.loads(log.metadata[schema.SOURCE]["kidnapped_at"]) == [12.5]
    np.testing.assert_allclose(log.odometry[4], [4.0, 0.0, 0.0], atol=1e-9)  # nothing turned the wheels any more
    turned = [compose((4.0, 0.0, -0.5), (0.5 + k, 0.0, 0.0)) for k in range(2)]
    np.testing.assert_allclose(log.odometry[5:7, :2], [t[:2] for t in turned], atol=1e-9)
    with pytest.raises(MclError, match="nothing is left"):
        convert([source], tmp_path / "b.mcap", drop=[(0.0, 99.0)])


def test_a_converted_file_is_not_converted_again(tmp_path: Path) -> None:
    convert([ordinary().write(tmp_path / "a.mcap")], tmp_path / "b.mcap")
    with pytest.raises(MclError, match=r"b\.mcap: mcl convert made this file .mcl localize"):
        convert([tmp_path / "b.mcap"], tmp_path / "c.mcap")


def test_only_bags_have_topics_to_choose(tmp_path: Path) -> None:
    (tmp_path / "a.log").write_text("O 1 2 3 4\n")
    with pytest.raises(MclError, match="a CMU O/L text log has no topics, frames and clocks to choose"):
        convert([tmp_path / "a.log"], tmp_path / "a.mcap", names=Names(scan_topic="/scan"))


def test_messages_that_are_promised_and_missing(tmp_path: Path) -> None:
    folder = ros2(ordinary(), tmp_path / "bag", StoragePlugin.SQLITE3)
    with sqlite3.connect(folder / "bag.db3") as database:
        database.execute("DELETE FROM messages WHERE topic_id = (SELECT id FROM topics WHERE name LIKE '%scan_front')")
    with pytest.raises(MclError, match=r"no laser scans .*promises 10 messages on /base/scan_front, and none is here"):
        convert([folder], tmp_path / "a.mcap")


def test_a_damaged_bag_is_refused_or_read(tmp_path: Path) -> None:
    whole = ros1(driven(), tmp_path / "a.bag").read_bytes()
    rng = random.Random(0)
    for _ in range(100):
        damaged = bytearray(whole)
        for _ in range(rng.choice([1, 5, 50])):
            damaged[rng.randrange(14, len(whole))] = rng.randrange(256)
        (tmp_path / "damaged.bag").write_bytes(damaged)
        with suppress(MclError):
            convert([tmp_path / "damaged.bag"], tmp_path / "out.mcap")


def test_bags_that_are_cut_or_none(tmp_path: Path) -> None:
    whole = ros1(ordinary(), tmp_path / "a.bag").read_bytes()
    (tmp_path / "cut.bag").write_bytes(whole[: len(whole) // 2])
    folder = ros2(ordinary(), tmp_path / "bag", StoragePlugin.SQLITE3)
    database = (folder / "bag.db3").read_bytes()
    (folder / "bag.db3").write_bytes(database[:5000])
    (tmp_path / "empty").mkdir()
    said = {"cut.bag": "cut or damaged", "bag": "cut or damaged", "empty": "no bag: it has no metadata.yaml"}
    for name, words in said.items():
        with pytest.raises(MclError, match=words) as caught:
            convert([tmp_path / name], tmp_path / "out.mcap")
        assert str(caught.value).startswith(str(tmp_path / name))
        assert "\n" not in str(caught.value)
    with pytest.raises(MclError, match="cannot be joined"):
        convert([tmp_path / "a.bag", tmp_path / "a.bag"], tmp_path / "out.mcap", join=True)
    assert not (tmp_path / "out.mcap").exists()


# --- real robots


@pytest.mark.parametrize(
    ("bag", "twin"),
    [
        ("uob_pioneer/trace0.bag", "uob_pioneer/trace0_ros2_mcap/uob_trace0.mcap"),
        ("uob_pioneer/trace0_ros2_mcap", "uob_pioneer/trace0_ros2_mcap/uob_trace0.mcap"),
        ("mcap_fixtures/uob_trace0_zstd_message", "uob_pioneer/trace0_ros2_mcap/uob_trace0.mcap"),
        ("mcap_fixtures/uob_trace0_zstd_file", "uob_pioneer/trace0_ros2_mcap/uob_trace0.mcap"),
        ("olin_mac/macfirst_floor_take_2", "olin_mac/macfirst_floor_take_2_mcap/olin.mcap"),
    ],
)
def test_real_bags_agree_with_their_twins(shared_data: Path, tmp_path: Path, bag: str, twin: str) -> None:
    same(converted(shared_data / bag, tmp_path), read_log(shared_data / twin))


def test_amcl_as_a_real_bag_recorded_it(shared_data: Path, tmp_path: Path) -> None:
    from pipeline.logs.tum import read_tum

    own = converted(shared_data / "uob_pioneer" / "trace0.bag", tmp_path, ground_truth=Path("/tf")).ground_truth
    theirs = read_tum(shared_data / "uob_pioneer" / "trace0_amcl_in_bag.tum")
    assert own is not None
    nearest = np.clip(np.searchsorted(own.stamps, theirs.stamps), 0, len(own.stamps) - 1)
    apart = np.hypot(*(own.poses[nearest] - theirs.poses)[:, :2].T)
    assert np.median(apart) < 0.05
