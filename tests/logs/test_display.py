"""What is in a log for the picture alone: read back by rosbags, and by our own reader as if it were not there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from pipeline.logs import schema
from pipeline.logs.columns import PoseColumns, ScanColumns, planar_poses
from pipeline.logs.messages import Log, Trajectory
from pipeline.logs.reader import read_log
from pipeline.logs.writer import write_log
from pipeline.maps.occupancy_grid import OccupancyGrid

STAMPS = np.array([5, 1_000_000_000, 2_000_000_007])
GRID = OccupancyGrid(np.zeros((20, 60), np.float32), 0.1, (-3.0, 4.0, 0.5))
TRUTH = Trajectory(STAMPS, np.array([[0.0, 5.0, 0.0], [1.0, 5.0, 0.0], [1.0, 6.0, 1.5]]))


def odometry(frame: str = "odom") -> PoseColumns:
    return planar_poses(
        STAMPS, np.arange(3), np.array([[-7.0, 1.0, 0.0], [-6.0, 1.0, 0.0], [-6.0, 2.0, 1.5]]), frame, "base_link"
    )


def write(path: Path, moved: PoseColumns, grid: OccupancyGrid | None, truth: Trajectory | None) -> Path:
    ranges = np.full((3, 4), 2.0, np.float32)
    scans = ScanColumns(STAMPS + 1, np.arange(3), ranges, -0.5, 0.25, 0.1, 10.0, "laser")
    write_log(path, scans, moved, (0.3, 0.0, 0.0), grid=grid, ground_truth=truth)
    return path


def read(path: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            found.setdefault(connection.topic, []).append(reader.deserialize(data, connection.msgtype))
    return found


def links(messages: list[Any]) -> list[tuple[str, str, float, float]]:
    transforms = [t for message in messages for t in message.transforms]
    moves = [t.transform.translation for t in transforms]
    return [(t.header.frame_id, t.child_frame_id, m.x, m.y) for t, m in zip(transforms, moves, strict=True)]


def points(cloud: Any) -> np.ndarray:
    return np.frombuffer(cloud.data, "<f4").reshape(cloud.width, 3)


def test_the_odometry_is_drawn_beside_the_map(tmp_path: Path) -> None:
    found = read(write(tmp_path / "a.mcap", odometry(), GRID, TRUTH))
    places = {child: (x, y) for parent, child, x, y in links(found["/view/tf"]) if parent == "view"}
    assert set(places) == {"map", "odom"}
    assert places["map"] == (0.0, 0.0)
    right = GRID.to_map([(6.0, 0.0, 0.0), (6.0, 2.0, 0.0)])[:, 0].max()
    assert (odometry().positions[:, 0] + places["odom"][0]).min() > max(right, TRUTH.poses[:, 0].max())


def test_nothing_that_is_navigated_by_says_where_the_odometry_is(office: Log) -> None:
    found = read(office.path)
    children = {child for topic in ("/tf", "/tf_static") for _, child, _, _ in links(found[topic])}
    assert children == {"base_link", "laser"}


def test_the_robot_and_its_path_can_be_seen(tmp_path: Path) -> None:
    found = read(write(tmp_path / "a.mcap", odometry(), GRID, TRUTH))
    for frame, topic in (("base_link", "/view/robot"), ("true_base_link", "/view/true_robot")):
        (robot,) = found[topic]
        assert robot.header.frame_id == frame
        assert np.abs(points(robot)).max() == pytest.approx(1.0)
    for frame, topic, poses in (
        ("odom", "/view/path", odometry().positions[:, :2]),
        ("map", "/view/true_path", TRUTH.poses[:, :2]),
    ):
        (path,) = found[topic]
        assert path.header.frame_id == frame
        np.testing.assert_allclose(points(path)[:, :2], poses, atol=1e-6)
    assert links(found["/view/true_tf"]) == [("map", "true_base_link", x, y) for x, y, _ in TRUTH.poses.tolist()]


@pytest.mark.parametrize(
    ("frame", "truth"), [("odom", None), ("world", Trajectory(STAMPS, TRUTH.poses, "world"))], ids=["alone", "the same"]
)
def test_one_frame_needs_no_place(tmp_path: Path, frame: str, truth: Trajectory | None) -> None:
    found = read(write(tmp_path / "a.mcap", odometry(frame), None, truth))
    assert "/view/tf" not in found
    assert "/view/robot" in found


def test_our_reader_takes_no_notice(tmp_path: Path) -> None:
    log = read_log(write(tmp_path / "a.mcap", odometry(), GRID, TRUTH))
    assert log.metadata[schema.READER]["frames"] == "odom -> base_link -> laser"
    assert len(log) == 2  # the last scan is after the last odometry
    np.testing.assert_allclose(log.odometry[:, :2], odometry().positions[:2, :2], atol=1e-6)
