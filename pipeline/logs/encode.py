"""Poses, scans and maps as ROS 2 would serialise them: what ``decode`` reads, the other way round."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.geometry import Pose, yaw_to_quaternion
from pipeline.logs import cdr, schema
from pipeline.logs.columns import GyroscopeColumns, PoseColumns, ScanColumns, planar_poses
from pipeline.logs.decode import typestore
from pipeline.logs.transforms import to_quaternion
from pipeline.maps.occupancy_grid import OccupancyGrid

Messages = tuple[NDArray[np.int64], NDArray[np.int64], list[bytes]]  # stamps, sequences, data


def odometry_messages(odometry: PoseColumns, twists: NDArray[np.float64] | None = None) -> Messages:
    """The odometry as Odometry messages; ``twists`` (n, 3) m/s, m/s, rad/s in the robot's frame, zeros if None."""
    rows = cdr.blank(len(odometry), cdr.ODOMETRY, frame_id=odometry.frame, child_frame_id=odometry.child_frame)
    if twists is not None:
        rows["twist"][:, (0, 1, 5)] = twists
    return _filled(rows, odometry)


def transform_messages(odometry: PoseColumns) -> Messages:
    """Poses of a frame in another as TFMessages, one transform each."""
    rows = cdr.blank(len(odometry), cdr.ONE_TRANSFORM, frame_id=odometry.frame, child_frame_id=odometry.child_frame)
    rows["transforms"] = 1
    return _filled(rows, odometry)


def static_message(frame: str, base: str, pose: Pose | NDArray[np.float64], stamp: int) -> Messages:
    """The place of ``frame`` on ``base``, in the plane or a 4x4 matrix, as the only TFMessage."""
    rows = cdr.blank(1, cdr.ONE_TRANSFORM, frame_id=base, child_frame_id=frame)
    rows["transforms"] = 1
    place = planar_poses(np.array([stamp]), np.zeros(1, np.int64), np.zeros((1, 3)), base, frame)
    if np.ndim(pose) == 2:
        matrix = np.asarray(pose, dtype=np.float64)
        place = replace(place, positions=matrix[None, :3, 3], orientations=to_quaternion(matrix)[None])
    else:
        place = planar_poses(place.stamps, place.sequences, np.array([pose]), base, frame)
    return _filled(rows, place)


def static_messages(frames: Mapping[str, Pose | NDArray[np.float64]], base: str, stamp: int) -> Messages:
    """The places of several frames on ``base`` as one TFMessage: of a latched topic only the last message is kept."""
    messages = [static_message(frame, base, pose, stamp) for frame, pose in frames.items()]
    if len(messages) == 1:
        return messages[0]
    store = typestore()
    transforms = [t for _, _, (data,) in messages for t in store.deserialize_cdr(data, schema.TF_TYPE).transforms]
    together = store.serialize_cdr(store.types[schema.TF_TYPE](transforms), schema.TF_TYPE)
    return messages[0][0], messages[0][1], [bytes(together)]


def pose_messages(poses: PoseColumns | None) -> Messages | None:
    """Poses as PoseStamped messages."""
    if poses is None:
        return None
    return _filled(cdr.blank(len(poses), cdr.POSE_STAMPED, frame_id=poses.frame), poses)


def _filled(rows: cdr.Rows, poses: PoseColumns) -> Messages:
    cdr.set_stamps(rows, poses.stamps)
    rows["position"], rows["orientation"] = poses.positions, poses.orientations
    return poses.stamps, poses.sequences, cdr.pack(rows)


def scan_messages(scans: ScanColumns, scan_time: float = 0.0) -> Messages:
    """The scans as LaserScan messages, ``scan_time`` seconds from one to the next (0: unknown)."""
    beams = scans.ranges.shape[1]
    rows = cdr.blank(len(scans), cdr.LASER_SCAN, {"ranges": beams}, frame_id=scans.frame)
    cdr.set_stamps(rows, scans.stamps)
    values: Iterable[tuple[str, Any]] = (
        ("angle_min", scans.angle_min),
        ("angle_max", scans.angle_min + scans.angle_increment * (beams - 1)),
        ("angle_increment", scans.angle_increment),
        ("time_increment", scans.time_increment),
        ("scan_time", scan_time),
        ("range_min", scans.range_min),
        ("range_max", scans.range_max),
        ("ranges", scans.ranges),
    )
    for name, value in values:
        rows[name] = value
    return scans.stamps, scans.sequences, cdr.pack(rows)


def gyroscope_messages(gyroscope: GyroscopeColumns | None) -> Messages | None:
    """The turn rates as Imu messages, which say that they know neither orientation nor acceleration."""
    if gyroscope is None:
        return None
    rows = cdr.blank(len(gyroscope.stamps), cdr.IMU, frame_id=gyroscope.frame)
    cdr.set_stamps(rows, gyroscope.stamps)
    rows["orientation"][:, 3] = 1.0
    rows["angular_velocity"][:, 2] = gyroscope.rates
    for name in ("orientation_covariance", "linear_acceleration_covariance"):
        rows[name][:, 0] = -1.0  # by this the message says: not measured
    return gyroscope.stamps, np.arange(len(gyroscope.stamps)), cdr.pack(rows)


def map_message(grid: OccupancyGrid, stamp: int) -> Messages:
    """The map as one OccupancyGrid: stamps, sequences and bytes of the only message."""
    rows = cdr.blank(1, cdr.OCCUPANCY_GRID, {"data": grid.occupancy.size}, frame_id=schema.MAP_FRAME)
    cdr.set_stamps(rows, np.array([stamp]))
    x, y, yaw = grid.origin
    percent = np.where(grid.known, np.round(grid.occupancy * 100.0), -1.0)
    values: Iterable[tuple[str, Any]] = (
        ("resolution", grid.resolution),
        ("width", grid.width),
        ("height", grid.height),
        ("position", (x, y, 0.0)),
        ("orientation", yaw_to_quaternion(yaw)),
        ("data", percent.astype(np.int8).reshape(-1)),
    )
    for name, value in values:
        rows[name] = value
    return np.array([stamp]), np.zeros(1, np.int64), cdr.pack(rows)
