from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from ruamel.yaml import YAML

from pipeline.errors import MclError
from pipeline.logs import schema
from pipeline.logs.columns import GyroscopeColumns, PoseColumns, ScanColumns, planar_poses
from pipeline.logs.messages import Trajectory
from pipeline.logs.reader import read_log
from pipeline.logs.writer import pack_grid, unpack_grid, write_log
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.outputs import check_output, replacing
from recordings import STORE

STAMPS = np.array([5, 1_000_000_000, 2_000_000_007])
POSES = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0], [2.0, 3.0, -3.1]])
GRID = OccupancyGrid(np.array([[np.nan, 0.254, 0.0], [1.0, 0.999, 0.5]], np.float32), 0.1, (-3.0, 4.0, 0.5))


def scans(ranges: float = 2.0) -> ScanColumns:
    return ScanColumns(STAMPS, np.arange(3), np.full((3, 4), ranges, np.float32), -0.5, 0.25, 0.1, 10.0, "laser")


def odometry() -> PoseColumns:
    return planar_poses(STAMPS, np.arange(3), POSES, "odom", "base_link")


def write(path: Path, **options: object) -> Path:
    options = {"grid": GRID, "ground_truth": Trajectory(STAMPS, POSES), "laser_poses": odometry()} | options
    write_log(path, scans(), odometry(), (0.3, -0.1, 0.2), **options)  # type: ignore[arg-type]
    return path


def test_the_file_keeps_the_contract(tmp_path: Path) -> None:
    gyroscope = GyroscopeColumns(STAMPS, np.array([0.1, -0.2, 0.3]))
    with write(tmp_path / "a.mcap", gyroscope=gyroscope).open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        channels = {channel.topic: channel for channel in summary.channels.values()}
        assert set(channels) == set(schema.TYPES)
        for topic, channel in channels.items():
            assert channel.message_encoding == "cdr"
            assert summary.schemas[channel.schema_id].name == schema.TYPES[topic]
            assert summary.schemas[channel.schema_id].encoding == "ros2msg"
            (qos,) = YAML(typ="safe").load(channel.metadata["offered_qos_profiles"])
            once = topic in ("/map", "/tf_static") or (topic.startswith("/view/") and not topic.endswith("tf"))
            assert qos["durability"] == (1 if once else 2)
            assert qos["reliability"] == 1
        assert summary.statistics.message_count == 2 + 6 * 3 + (2 + 2 + 3 + 2)
        assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}
        times = [message.log_time for _, _, message in reader.iter_messages(log_time_order=False)]
        assert times == sorted(times)


def test_rosbags_reads_every_message(tmp_path: Path) -> None:
    found: dict[str, list[object]] = {}
    with write(tmp_path / "a.mcap").open("rb") as file:
        for kind, channel, message in make_reader(file).iter_messages():
            assert kind is not None
            decoded = STORE.deserialize_cdr(message.data, kind.name)
            assert bytes(STORE.serialize_cdr(decoded, kind.name)) == message.data
            found.setdefault(channel.topic, []).append(decoded)
    odom, tf, static = found["/odom"][1], found["/tf"][1].transforms[0], found["/tf_static"][0].transforms[0]  # type: ignore[attr-defined]
    assert (odom.header.frame_id, odom.child_frame_id) == ("odom", "base_link")  # type: ignore[attr-defined]
    assert (tf.header.frame_id, tf.child_frame_id, tf.transform.translation.y) == ("odom", "base_link", 2.0)
    assert (static.header.frame_id, static.child_frame_id) == ("base_link", "laser")
    assert (static.transform.translation.x, static.transform.translation.y) == (0.3, -0.1)
    drawn = found["/map"][0]
    assert drawn.data.tolist() == [-1, 25, 0, 100, 100, 50]  # type: ignore[attr-defined]
    assert (drawn.info.width, drawn.info.height) == (3, 2)  # type: ignore[attr-defined]


def test_a_scans_times_and_a_gyroscopes_turn_rates_are_told(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    timed = replace(scans(), time_increment=0.001)
    gyroscope = GyroscopeColumns(STAMPS, np.array([0.1, -0.2, 0.3]), "imu")
    write_log(path, timed, odometry(), (0.3, -0.1, 0.2), gyroscope=gyroscope, scan_time=0.25)
    found: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        for kind, channel, message in make_reader(file).iter_messages():
            assert kind is not None
            decoded = STORE.deserialize_cdr(message.data, kind.name)
            assert bytes(STORE.serialize_cdr(decoded, kind.name)) == message.data
            found.setdefault(channel.topic, []).append(decoded)
    assert [m.time_increment for m in found["/scan"]] == [np.float32(0.001)] * 3
    assert [m.scan_time for m in found["/scan"]] == [0.25] * 3
    assert [m.angular_velocity.z for m in found["/imu"]] == [0.1, -0.2, 0.3]
    assert [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in found["/imu"]] == STAMPS.tolist()
    assert {m.header.frame_id for m in found["/imu"]} == {"imu"}
    assert found["/imu"][0].orientation_covariance[0] == found["/imu"][0].linear_acceleration_covariance[0] == -1.0
    (static,) = found["/tf_static"]
    places = {t.child_frame_id: t.transform.translation.x for t in static.transforms}
    assert places == {"laser": 0.3, "imu": 0.0}
    assert {t.header.frame_id for t in static.transforms} == {"base_link"}
    np.testing.assert_allclose(read_log(path).laser.pose, (0.3, -0.1, 0.2), atol=1e-12)


def test_everything_is_read_back(tmp_path: Path) -> None:
    log = read_log(write(tmp_path / "a.mcap", metadata={"mcl:source": {"format": "test"}}))
    np.testing.assert_array_equal(log.stamps, STAMPS)
    np.testing.assert_allclose(log.odometry, POSES, atol=1e-12)
    assert log.grid is not None
    assert log.grid.sha256 == GRID.sha256
    assert log.ground_truth is not None
    np.testing.assert_allclose(log.ground_truth.poses, POSES, atol=1e-12)
    np.testing.assert_allclose(log.laser.pose, (0.3, -0.1, 0.2), atol=1e-12)
    assert log.metadata["mcl:source"] == {"format": "test"}


def test_the_map_attachment_loses_nothing() -> None:
    again = unpack_grid(pack_grid(GRID))
    assert again.sha256 == GRID.sha256
    assert pack_grid(GRID) == pack_grid(again)


def test_without_map_and_truth(tmp_path: Path) -> None:
    log = read_log(write(tmp_path / "deep" / "er" / "a.mcap", grid=None, ground_truth=None, laser_poses=None))
    assert log.grid is None
    assert log.ground_truth is None


def test_a_file_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_text("before")
    with pytest.raises(KeyError), replacing(path) as temporary:  # noqa: PT012
        temporary.write_text("half")
        raise KeyError
    assert path.read_text() == "before"
    with replacing(path) as temporary:
        temporary.write_text("after")
        assert path.read_text() == "before"
    assert path.read_text() == "after"
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(MclError, match="cannot be written"), replacing(path / "below"):
        pass
    with pytest.raises(MclError) as told, replacing(path) as temporary:
        raise OSError(28, "No space left on device", str(temporary))
    assert str(told.value) == f"{path}: cannot be written: No space left on device"
    assert path.read_text() == "after"


def test_a_folder_that_takes_nothing_is_known_before_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    check_output(tmp_path / "a", force=False)

    def refuse(dir: Path) -> None:
        raise OSError(30, "Read-only file system", str(dir / "tmp1234"))

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    with pytest.raises(MclError) as told:
        check_output(tmp_path / "a", force=False)
    assert str(told.value) == f"{tmp_path / 'a'}: cannot be written: Read-only file system"
    assert not list(tmp_path.iterdir())
