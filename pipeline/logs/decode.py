"""ROS 2 messages as bytes into columns: all at once where their bytes allow it, through rosbags where they do not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.geometry import quaternion_to_yaw
from pipeline.logs import cdr
from pipeline.logs.columns import PoseColumns, ScanColumns
from pipeline.logs.mcap_file import Messages
from pipeline.maps.occupancy_grid import OccupancyGrid

_SCAN_CONSTANTS = ("angle_min", "angle_increment", "range_min", "range_max")


def decode_scans(messages: Messages) -> ScanColumns:
    """LaserScan messages; scans whose beams differ from most of the others are brought onto the beams of those."""
    rows = cdr.unpack(messages.data, cdr.LASER_SCAN)
    if rows is None or any((rows[name] != rows[name][0]).any() for name in _SCAN_CONSTANTS):
        return _scans_one_by_one(messages)
    beams = int(rows["ranges_length"][0])
    ranges = rows["ranges"].astype(np.float32) if beams else np.empty((len(rows), 0), np.float32)
    constants = {name: float(rows[name][0]) for name in _SCAN_CONSTANTS}
    frame = rows["frame_id"][0].decode() if "frame_id" in (rows.dtype.names or ()) else ""
    return ScanColumns(cdr.stamps_of(rows), messages.sequences, ranges, frame=frame, **constants)


def decode_odometry(messages: Messages) -> PoseColumns:
    """Odometry messages: the pose of the child frame, covariances and velocities left aside."""
    rows = cdr.unpack(messages.data, cdr.ODOMETRY)
    if rows is not None:
        return _poses(rows, messages)
    decoded = _deserialize(messages)
    return _poses_one_by_one([(m.header, m.pose.pose, m.child_frame_id) for m in decoded], messages)


def decode_poses(messages: Messages) -> PoseColumns:
    """PoseStamped messages."""
    rows = cdr.unpack(messages.data, cdr.POSE_STAMPED)
    if rows is not None:
        return _poses(rows, messages)
    return _poses_one_by_one([(m.header, m.pose, "") for m in _deserialize(messages)], messages)


def decode_transforms(messages: Messages) -> dict[str, tuple[str, NDArray[np.float64]]]:
    """TFMessage messages: the first transform of every child frame, as (parent frame, 4x4 matrix)."""
    result: dict[str, tuple[str, NDArray[np.float64]]] = {}
    rows = cdr.unpack(messages.data, cdr.ONE_TRANSFORM)
    if rows is not None and (rows["transforms"] == 1).all():
        poses = _poses(rows[:1], messages)
        matrix = _matrix(poses.positions[0].tolist(), poses.orientations[0].tolist())
        return {poses.child_frame.lstrip("/"): (poses.frame.lstrip("/"), matrix)}
    for message in _deserialize(messages):
        for item in message.transforms:
            child = item.child_frame_id.lstrip("/")
            if child not in result:
                t, q = item.transform.translation, item.transform.rotation
                result[child] = (item.header.frame_id.lstrip("/"), _matrix((t.x, t.y, t.z), (q.x, q.y, q.z, q.w)))
    return result


def decode_grid(messages: Messages) -> OccupancyGrid:
    """The last OccupancyGrid message: what a late subscriber to a latched map would get."""
    last = Messages(messages.topic, messages.log_times[-1:], messages.sequences[-1:], messages.data[-1:])
    message = _deserialize(last)[0]
    info = message.info
    cells = np.asarray(message.data, dtype=np.int8)
    if cells.size != info.width * info.height:
        raise MclError(f"{messages.topic.name}: {cells.size} cells where {info.width} x {info.height} are announced")
    cells = cells.reshape(info.height, info.width)
    occupancy = np.where((cells >= 0) & (cells <= 100), cells / np.float32(100.0), np.nan).astype(np.float32)
    p, q = info.origin.position, info.origin.orientation
    yaw = float(quaternion_to_yaw(q.x, q.y, q.z, q.w))
    resolution = float(str(np.float32(info.resolution)))  # 0.1, not the 0.10000000149 that float32 makes of it
    return OccupancyGrid(occupancy, resolution, (float(p.x), float(p.y), yaw))


def _poses(rows: cdr.Rows, messages: Messages) -> PoseColumns:
    names = rows.dtype.names or ()
    return PoseColumns(
        cdr.stamps_of(rows),
        messages.sequences[: len(rows)],
        rows["position"].astype(np.float64),
        rows["orientation"].astype(np.float64),
        rows["frame_id"][0].decode() if "frame_id" in names else "",
        rows["child_frame_id"][0].decode() if "child_frame_id" in names else "",
    )


def _poses_one_by_one(decoded: Sequence[tuple[Any, Any, str]], messages: Messages) -> PoseColumns:
    frame, child = decoded[0][0].frame_id, decoded[0][2]
    for header, _, other in decoded:
        if (header.frame_id, other) != (frame, child):
            raise MclError(f"{messages.topic.name} mixes frames: {frame!r} and {header.frame_id!r}")
    points, turns = [p.position for _, p, _ in decoded], [p.orientation for _, p, _ in decoded]
    return PoseColumns(
        np.array([_stamp(header) for header, _, _ in decoded], dtype=np.int64),
        messages.sequences,
        np.array([(p.x, p.y, p.z) for p in points], dtype=np.float64),
        np.array([(q.x, q.y, q.z, q.w) for q in turns], dtype=np.float64),
        frame,
        child,
    )


def _scans_one_by_one(messages: Messages) -> ScanColumns:
    decoded = _deserialize(messages)
    frames = sorted({m.header.frame_id for m in decoded})
    if len(frames) > 1:
        raise MclError(f"{messages.topic.name} mixes the scans of several lasers: {', '.join(frames)}")
    shapes = [(m.angle_min, m.angle_increment, m.range_min, m.range_max, len(m.ranges)) for m in decoded]
    angle_min, increment, range_min, range_max, beams = Counter(shapes).most_common(1)[0][0]
    ranges = np.full((len(decoded), beams), np.nan, dtype=np.float32)
    angles = angle_min + increment * np.arange(beams)
    for row, message in zip(ranges, decoded, strict=True):
        own = message.ranges
        if len(own) == 0 or message.angle_increment == 0.0:
            continue
        nearest = np.rint((angles - message.angle_min) / message.angle_increment).astype(np.int64)
        inside = (nearest >= 0) & (nearest < len(own))
        row[inside] = own[nearest[inside]]
    stamps = np.array([_stamp(m.header) for m in decoded], dtype=np.int64)
    constants = (float(angle_min), float(increment), float(range_min), float(range_max))
    return ScanColumns(stamps, messages.sequences, ranges, *constants, frames[0])


def _deserialize(messages: Messages) -> list[Any]:
    store, kind = _typestore(), messages.topic.type
    try:
        return [store.deserialize_cdr(data, kind) for data in messages.data]
    except Exception as error:  # rosbags raises whatever its generated code stumbles over
        said = " ".join(str(error).split())[:80] or type(error).__name__
        raise MclError(f"{messages.topic.name}: a message is no {kind}: {said}") from error


@cache
def _typestore() -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def _stamp(header: Any) -> int:
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def _matrix(translation: Sequence[float], rotation: Sequence[float]) -> NDArray[np.float64]:
    x, y, z, w = np.asarray(rotation, dtype=np.float64) / (np.linalg.norm(rotation) or 1.0)
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = translation
    return matrix
