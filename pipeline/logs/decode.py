"""ROS 2 messages as bytes into columns: all at once where their bytes allow it, through rosbags where they do not.

What no robot says (``sound``) and stamps from nowhere (``stretches``) are left out here, once for all who read on.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.geometry import compose, quaternion_to_yaw
from pipeline.logs import cdr, schema
from pipeline.logs.columns import PoseColumns, ScanColumns
from pipeline.logs.recorded import Messages
from pipeline.logs.sound import FARTHEST, sound_limits, sound_poses, unlikely_constants
from pipeline.logs.stretches import numbered
from pipeline.maps.occupancy_grid import LARGE, OccupancyGrid, check_cells, cropped, part_that_is_known

Columns = TypeVar("Columns", ScanColumns, PoseColumns)

_ALIKE = 1e-6  # m, and parts of a quaternion: two transforms that differ by less are one
_NOT_MEASURED = -1.0  # the first of a covariance, by which an Imu message says that what it belongs to is empty
_SCAN_CONSTANTS = ("angle_min", "angle_increment", "range_min", "range_max")


def decode_scans(messages: Messages, frame: str | None = None) -> ScanColumns:
    """LaserScan messages; scans whose beams differ from most of the others are brought onto the beams of those.

    Of MultiEchoLaserScan messages each beam's first echo. ``frame``: the laser to take, where the topic has several;
    MclError if it has several and none is given.
    """
    rows = cdr.unpack(messages.data, cdr.LASER_SCAN) if messages.topic.type == schema.LASER_SCAN_TYPE else None
    if rows is None or any((rows[name] != rows[name][0]).any() for name in _SCAN_CONSTANTS):
        return _scans_one_by_one(messages, frame)
    beams = int(rows["ranges_length"][0])
    ranges = rows["ranges"].astype(np.float32) if beams else np.empty((len(rows), 0), np.float32)
    angle_min, increment, range_min, range_max = (float(rows[name][0]) for name in _SCAN_CONSTANTS)
    constants = (angle_min, increment, range_min, range_max)
    if wrong := unlikely_constants(constants, beams):
        raise MclError(f"{messages.topic.name}: no scan can be used: {wrong}")
    stamps = _stamped(cdr.stamps_of(rows), messages)
    pace = _pace(rows["time_increment"])
    name = _decoded(rows["frame_id"][0]) if "frame_id" in (rows.dtype.names or ()) else ""
    scans = ScanColumns(stamps, messages.sequences, ranges, *constants, frame=name, time_increment=pace)
    return _in_stretches(sound_limits(scans, messages.topic.name), messages.topic.name)


def decode_odometry(messages: Messages) -> PoseColumns:
    """Odometry messages: the pose of the child frame, covariances and velocities left aside."""
    rows = cdr.unpack(messages.data, cdr.ODOMETRY)
    if rows is not None:
        return _poses(rows, messages)
    decoded = _deserialize(messages)
    return _poses_one_by_one([(m.header, m.pose.pose, m.child_frame_id) for m in decoded], messages)


def decode_rates(messages: Messages) -> tuple[NDArray[np.int64], NDArray[np.float64], str]:
    """Imu messages: stamps (n,) ns, angular velocities (n, 3) rad/s in the sensor's own frame, and that frame.

    NaN where the message says that it does not know the velocity. Raises MclError if the topic mixes frames.
    """
    rows = cdr.unpack(messages.data, cdr.IMU)
    if rows is not None:
        frame = _decoded(rows["frame_id"][0]) if "frame_id" in (rows.dtype.names or ()) else ""
        rates = rows["angular_velocity"].astype(np.float64)
        rates[rows["angular_velocity_covariance"][:, 0] == _NOT_MEASURED] = np.nan
        return _stamped(cdr.stamps_of(rows), messages), rates, _frame(frame)
    decoded = _deserialize(messages)
    frames = sorted({m.header.frame_id for m in decoded})
    if len(frames) > 1:
        raise MclError(f"{messages.topic.name} mixes several sensors: {', '.join(frames)}")
    stamps = np.array([_stamp(m.header) for m in decoded], dtype=np.int64)
    rates = np.array([(m.angular_velocity.x, m.angular_velocity.y, m.angular_velocity.z) for m in decoded])
    rates[[m.angular_velocity_covariance[0] == _NOT_MEASURED for m in decoded]] = np.nan
    return _stamped(stamps, messages), rates, _frame(frames[0])


def decode_poses(messages: Messages) -> PoseColumns:
    """PoseStamped messages."""
    rows = cdr.unpack(messages.data, cdr.POSE_STAMPED)
    if rows is not None:
        return _poses(rows, messages)
    return _poses_one_by_one([(m.header, m.pose, "") for m in _deserialize(messages)], messages)


def decode_stamped_poses(messages: Messages) -> PoseColumns:
    """PoseWithCovarianceStamped messages: the poses."""
    return _poses_one_by_one([(m.header, m.pose.pose, "") for m in _deserialize(messages)], messages)


def decode_links(messages: Messages, *, static: bool = False) -> tuple[dict[str, PoseColumns], dict[str, list[str]]]:
    """TFMessage messages: the transforms of every child frame from the first parent that it is said to have.

    Of ``static`` ones the last of each: as in tf2, what is said last counts. Also remarks, by child frame.
    """
    rows = cdr.unpack(messages.data, cdr.ONE_TRANSFORM)
    if rows is not None and (rows["transforms"] == 1).all():
        link = _columns_of_poses(rows, messages)
        link = replace(link, frame=_frame(link.frame), child_frame=_frame(link.child_frame))
        return _sound_links([link], messages, static)
    found: dict[str, tuple[str, list[tuple[int, ...]], list[tuple[float, ...]]]] = {}
    for number, message in enumerate(_deserialize(messages)):
        for item in message.transforms:
            parent, child = _frame(item.header.frame_id), _frame(item.child_frame_id)
            first, stamps, values = found.setdefault(child, (parent, [], []))
            if parent != first and static:
                first, stamps, values = found[child] = (parent, [], [])
            if parent == first:
                t, q = item.transform.translation, item.transform.rotation
                stamps.append((_stamp(item.header), number))
                values.append((t.x, t.y, t.z, q.x, q.y, q.z, q.w))
    links = []
    for child, (parent, stamps, values) in found.items():
        times, rows_of = np.array(stamps, dtype=np.int64).T
        numbers = np.array(values, dtype=np.float64)
        if messages.by_log_time:
            times = messages.log_times[rows_of]
        links.append(PoseColumns(times, messages.sequences[rows_of], numbers[:, :3], numbers[:, 3:], parent, child))
    return _sound_links(links, messages, static)


def _sound_links(
    links: Iterable[PoseColumns], messages: Messages, static: bool
) -> tuple[dict[str, PoseColumns], dict[str, list[str]]]:
    sound: dict[str, PoseColumns] = {}
    remarks: dict[str, list[str]] = {}
    for link in links:
        what = f"{messages.topic.name}, {link.frame} -> {link.child_frame}"
        said = remarks.setdefault(link.child_frame, [])
        try:
            usable = sound_poses(link, what)
        except MclError as error:
            said.append(error.message)
            continue
        said += usable.remarks
        if not static:
            usable = _in_stretches(usable, what)
        elif len(usable) > 1:
            places = np.column_stack([usable.positions, usable.orientations])
            if np.abs(places - places[-1]).max() > _ALIKE:
                said.append(f"{what} is said {len(places)} times and differently: the last counts, as in tf2")
            usable = usable.take(np.array([len(usable) - 1]))
        sound[link.child_frame] = replace(usable, remarks=())
    return sound, remarks


def decode_grid(messages: Messages) -> OccupancyGrid:
    """The last OccupancyGrid message: what a late subscriber to a latched map would get.

    Raises MclError if its numbers are none that a map can have.
    """
    last = Messages(messages.topic, messages.log_times[-1:], messages.sequences[-1:], messages.data[-1:])
    message = _deserialize(last)[0]
    info = message.info
    cells = np.asarray(message.data, dtype=np.int8)
    if cells.size != info.width * info.height:
        raise MclError(f"{messages.topic.name}: {cells.size} cells where {info.width} x {info.height} are announced")
    cells, corner, remarks = cells.reshape(info.height, info.width), (0.0, 0.0, 0.0), []
    if cells.size > LARGE:
        said = np.isin(np.arange(256), np.arange(101))
        rows, columns = part_that_is_known(cells.view(np.uint8), said)
        remarks.append(f"{messages.topic.name}: {cropped(cells.shape, rows, columns)}")
        corner = (columns.start * float(info.resolution), rows.start * float(info.resolution), 0.0)
        cells = cells[rows, columns]
    check_cells(cells.shape)
    occupancy = np.where((cells >= 0) & (cells <= 100), cells / np.float32(100.0), np.nan).astype(np.float32)
    p, q = info.origin.position, info.origin.orientation
    resolution = float(str(np.float32(info.resolution)))  # 0.1, not the 0.10000000149 that float32 makes of it
    name = messages.topic.name
    if not (np.isfinite(resolution) and resolution > 0.0):
        raise MclError(f"{name}: its resolution is {resolution:g} m", "give another map with --map")
    if not np.abs([p.x, p.y]).max() <= FARTHEST:  # nor if it is no number
        raise MclError(f"{name}: its origin is x = {p.x:g}, y = {p.y:g}", "give another map with --map")
    yaw = float(quaternion_to_yaw(q.x, q.y, q.z, q.w))
    if not np.isfinite(yaw):
        yaw = 0.0
        remarks.append(f"{name}: the yaw of its origin is no number: taken for 0")
    if len(set(messages.data)) > 1:
        remarks.append(f"{name}: {len(messages.data):,} maps were recorded, and differ: the last is used")
    origin = (float(p.x), float(p.y), yaw)
    if any(corner):
        x, y, _ = compose(origin, corner).tolist()
        origin = (x, y, yaw)
    return OccupancyGrid(occupancy, resolution, origin, tuple(remarks))


def _poses(rows: cdr.Rows, messages: Messages) -> PoseColumns:
    return _sound(_columns_of_poses(rows, messages), messages)


def _sound(poses: PoseColumns, messages: Messages) -> PoseColumns:
    return _in_stretches(sound_poses(poses, messages.topic.name), messages.topic.name)


def _in_stretches(columns: Columns, what: str) -> Columns:
    """With the stretch of every message, and without those whose stamps are from nowhere."""
    stretch = numbered(columns.stamps)
    if stretch is None:
        return columns
    stray = stretch < 0
    if stray.any():
        first = int(np.flatnonzero(stray)[0])
        said = (
            f"{what}: {int(stray.sum()):,} of {len(stretch):,} messages left out, their stamps are far from those "
            f"around them: message {first + 1:,} is of {columns.stamps[first] / 1e9:.3f} s"
        )
        columns, stretch = replace(columns.take(~stray), remarks=(*columns.remarks, said)), stretch[~stray]
    return replace(columns, stretch=stretch if stretch.any() else None)


def _columns_of_poses(rows: cdr.Rows, messages: Messages) -> PoseColumns:
    names = rows.dtype.names or ()
    return PoseColumns(
        _stamped(cdr.stamps_of(rows), messages),
        messages.sequences,
        rows["position"].astype(np.float64),
        rows["orientation"].astype(np.float64),
        _decoded(rows["frame_id"][0]) if "frame_id" in names else "",
        _decoded(rows["child_frame_id"][0]) if "child_frame_id" in names else "",
    )


def _poses_one_by_one(decoded: Sequence[tuple[Any, Any, str]], messages: Messages) -> PoseColumns:
    frame, child = decoded[0][0].frame_id, decoded[0][2]
    for header, _, other in decoded:
        if (header.frame_id, other) != (frame, child):
            raise MclError(
                f"{messages.topic.name} mixes frames: {frame!r} -> {child!r} and {header.frame_id!r} -> {other!r}"
            )
    points, turns = [p.position for _, p, _ in decoded], [p.orientation for _, p, _ in decoded]
    poses = PoseColumns(
        _stamped(np.array([_stamp(header) for header, _, _ in decoded], dtype=np.int64), messages),
        messages.sequences,
        np.array([(p.x, p.y, p.z) for p in points], dtype=np.float64),
        np.array([(q.x, q.y, q.z, q.w) for q in turns], dtype=np.float64),
        frame,
        child,
    )
    return _sound(poses, messages)


def _scans_one_by_one(messages: Messages, frame: str | None) -> ScanColumns:
    decoded = _deserialize(messages)
    stamps = _stamped(np.array([_stamp(m.header) for m in decoded], dtype=np.int64), messages)
    sequences, name = messages.sequences, messages.topic.name
    frames = sorted({m.header.frame_id for m in decoded})
    if len(frames) > 1:
        mine = np.array([_frame(m.header.frame_id) == _frame(frame or "") for m in decoded])
        if not mine.any():
            several = f"{name} mixes the scans of several lasers: {', '.join(frames)}"
            raise MclError(several, "--laser-frame takes one of them")
        decoded = [m for m, taken in zip(decoded, mine, strict=True) if taken]
        stamps, sequences = stamps[mine], sequences[mine]
    shapes = [(m.angle_min, m.angle_increment, m.range_min, m.range_max, len(m.ranges)) for m in decoded]
    wrong = [unlikely_constants(shape[:4], shape[4]) for shape in shapes]
    remarks: tuple[str, ...] = ()
    if any(wrong):
        number = next(i for i, said in enumerate(wrong) if said)
        usable = np.array([not said for said in wrong])
        if not usable.any():
            raise MclError(f"{name}: no scan can be used: {wrong[0]}")
        left_out = f"{name}: {int((~usable).sum()):,} of {len(decoded):,} messages left out"
        remarks = (f"{left_out}: in message {number + 1:,} {wrong[number]}",)
        decoded = [m for m, taken in zip(decoded, usable, strict=True) if taken]
        shapes = [shape for shape, taken in zip(shapes, usable, strict=True) if taken]
        stamps, sequences = stamps[usable], sequences[usable]
    shape, common = Counter(shapes).most_common(1)[0]
    angle_min, increment, range_min, range_max, beams = shape
    ranges = np.full((len(decoded), beams), np.nan, dtype=np.float32)
    angles = angle_min + increment * np.arange(beams)
    echoes = messages.topic.type == schema.MULTI_ECHO_TYPE
    for row, message, own_shape in zip(ranges, decoded, shapes, strict=True):
        own = _first_echoes(message.ranges) if echoes else message.ranges
        if own_shape == shape:
            row[:] = own
        elif len(own) and message.angle_increment:
            turn = 2 * np.pi / abs(message.angle_increment)  # in beams; a full turn may begin anywhere
            with np.errstate(all="ignore"):  # an increment of almost nothing leads nowhere
                offset = (angles - message.angle_min) / message.angle_increment
                place = np.nan_to_num(np.rint((offset + 0.5) % turn - 0.5), nan=-1.0, posinf=-1.0, neginf=-1.0)
            nearest = np.clip(place, -1, len(own)).astype(np.int64)
            inside = (nearest >= 0) & (nearest < len(own))
            row[inside] = own[nearest[inside]]
    constants = (float(angle_min), float(increment), float(range_min), float(range_max))
    own_pace = [m.time_increment for m, own in zip(decoded, shapes, strict=True) if own == shape]
    scans = ScanColumns(
        stamps,
        sequences,
        ranges,
        *constants,
        frame=decoded[0].header.frame_id,
        resampled=len(decoded) - common,
        time_increment=_pace(np.array(own_pace, dtype=np.float32)),
        remarks=remarks,
    )
    return _in_stretches(sound_limits(scans, name), name)


def _first_echoes(beams: Sequence[Any]) -> NDArray[np.float32]:
    """The nearest thing that each beam met; NaN for a beam without any echo."""
    return np.array([beam.echoes[0] if len(beam.echoes) else np.nan for beam in beams], dtype=np.float32)


def _pace(time_increments: NDArray[np.float32]) -> float:
    """Seconds from beam to beam, the median over the scans; NaN if a scan says nothing that is a number."""
    median = np.median(time_increments)
    return float(str(np.float32(median)))  # 0.001, not the 0.0010000000475 that float32 makes of it


def _stamped(stamps: NDArray[np.int64], messages: Messages) -> NDArray[np.int64]:
    """The headers' stamps; when the messages were written down if nobody stamped them, or if that was asked for."""
    return stamps if stamps.any() and not messages.by_log_time else messages.log_times


def _decoded(name: bytes) -> str:
    return name.decode(errors="replace")


def _frame(name: str) -> str:
    return name.lstrip("/")  # as ROS 1 wrote it


def _deserialize(messages: Messages) -> list[Any]:
    store, kind = typestore(), messages.topic.type
    try:
        return [store.deserialize_cdr(data, kind) for data in messages.data]
    except Exception as error:  # rosbags raises whatever its generated code stumbles over
        said = " ".join(str(error).split())[:80] or type(error).__name__
        raise MclError(f"{messages.topic.name}: a message is no {kind}: {said}") from error


@cache
def typestore() -> Any:
    """The message types of ROS 2, by which rosbags reads and writes single messages."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def _stamp(header: Any) -> int:
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)
