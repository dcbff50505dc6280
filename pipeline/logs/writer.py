"""Writes a log as one .mcap by the contract in ``schema``: complete under its name, or not at all."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline import __version__
from pipeline.errors import MclError
from pipeline.geometry import Pose
from pipeline.logs import schema
from pipeline.logs.columns import GyroscopeColumns, PoseColumns, ScanColumns, planar_poses
from pipeline.logs.display import display_messages
from pipeline.logs.encode import (
    Messages,
    gyroscope_messages,
    map_message,
    odometry_messages,
    pose_messages,
    scan_messages,
    static_messages,
    transform_messages,
)
from pipeline.logs.messages import Trajectory
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.outputs import replacing


def write_log(
    path: Path,
    scans: ScanColumns,
    odometry: PoseColumns | None,
    laser_pose: Pose | NDArray[np.float64],
    *,
    grid: OccupancyGrid | None = None,
    ground_truth: Trajectory | None = None,
    laser_poses: PoseColumns | None = None,
    gyroscope: GyroscopeColumns | None = None,
    scan_time: float = 0.0,
    metadata: Mapping[str, Mapping[str, str]] | None = None,
    attachments: Mapping[str, bytes] | None = None,
) -> None:
    """Writes scans, odometry (once more as /tf) if there is any, the laser's pose in base_link, and what else is known.

    ``laser_pose``: in the plane, or a 4x4 matrix where the laser hangs upside down. ``gyroscope``: its frame, if it
    has one, is written as lying at the centre of base_link. ``scan_time``: seconds from scan to scan, 0 if unknown.
    The file appears under its name when it is complete; a file that was there before survives a failure. Raises
    MclError if it cannot be written, and for stamps before 1970, which an .mcap has no place for.
    """
    start = int(min(columns.stamps.min() for columns in (scans, odometry, gyroscope) if columns is not None))
    if start < 0:
        raise MclError(
            f"a stamp of {start / 1e9:.3f} s is before 1970", "--stamps log takes when they were written down"
        )
    start = int(min(columns.stamps.min() for columns in (scans, odometry) if columns is not None))
    base = schema.BASE_FRAME if odometry is None else odometry.child_frame
    truth = _truth_columns(ground_truth)
    frames: dict[str, Pose | NDArray[np.float64]] = {scans.frame: laser_pose}
    if gyroscope is not None and gyroscope.frame != base:
        frames[gyroscope.frame] = (0.0, 0.0, 0.0)
    topics: dict[str, Messages | None] = {
        schema.MAP: None if grid is None else map_message(grid, start),
        schema.TF_STATIC: static_messages(frames, base, start),
        schema.ODOMETRY: None if odometry is None else odometry_messages(odometry),
        schema.TF: None if odometry is None else transform_messages(odometry),
        schema.SCAN: scan_messages(scans, scan_time),
        schema.IMU: gyroscope_messages(gyroscope),
        schema.LASER_POSE: pose_messages(laser_poses),
        schema.GROUND_TRUTH: pose_messages(truth),
        **display_messages(odometry, grid, truth, start=start, first_scan=int(scans.stamps.min())),
    }
    files = dict(attachments or {})
    if grid is not None:
        files[schema.MAP_CELLS] = pack_grid(grid)
    with replacing(path) as temporary, temporary.open("wb") as file:
        _write(file, topics, metadata or {}, files, start)


def pack_grid(grid: OccupancyGrid) -> bytes:
    """The map with all its digits, as the attachment that ``unpack_grid`` reads."""
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        occupancy=grid.occupancy.astype(np.float32),
        resolution=np.float64(grid.resolution),
        origin=np.array(grid.origin, dtype=np.float64),
    )
    return buffer.getvalue()


def unpack_grid(data: bytes) -> OccupancyGrid:
    """The map from the attachment that ``pack_grid`` made. Raises MclError if it is damaged."""
    try:
        with np.load(io.BytesIO(data)) as cells:
            x, y, yaw = map(float, cells["origin"].tolist())
            grid = OccupancyGrid(cells["occupancy"], float(cells["resolution"]), (x, y, yaw))
        known = grid.occupancy[grid.known]
        sound = grid.occupancy.ndim == 2 and grid.resolution > 0.0 and np.isfinite([grid.resolution, x, y, yaw]).all()
        if not sound or not ((known >= 0.0) & (known <= 1.0)).all():
            raise ValueError("numbers that no map has")
    except Exception as error:  # numpy raises whatever it stumbles over
        raise MclError("the map that travels in this file is damaged", "give it with --map") from error
    return grid


def _write(
    file: io.BufferedWriter,
    topics: Mapping[str, Messages | None],
    metadata: Mapping[str, Mapping[str, str]],
    attachments: Mapping[str, bytes],
    start: int,
) -> None:
    from mcap.writer import CompressionType, Writer

    writer = Writer(file, compression=CompressionType.ZSTD)
    writer.start(profile=schema.PROFILE, library=f"mcl-replay/{__version__}")
    entries: list[tuple[int, int, int, bytes]] = []
    schemas: dict[str, int] = {}
    for topic, messages in topics.items():
        if messages is None:
            continue
        kind = schema.TYPES[topic]
        if kind not in schemas:
            schemas[kind] = writer.register_schema(kind, schema.SCHEMA_ENCODING, definition(kind))
        qos = {"offered_qos_profiles": schema.qos_profile(topic)}
        channel = writer.register_channel(topic, schema.MESSAGE_ENCODING, schemas[kind], qos)
        stamps, sequences, data = messages
        entries += zip(stamps.tolist(), sequences.tolist(), [channel] * len(data), data, strict=True)
    for stamp, sequence, channel, message in sorted(entries, key=lambda entry: entry[:3]):
        writer.add_message(channel, log_time=stamp, publish_time=stamp, sequence=sequence, data=message)
    for name, record in metadata.items():
        writer.add_metadata(name, dict(record))
    for name, content in attachments.items():
        media = "application/octet-stream"
        writer.add_attachment(create_time=0, log_time=start, name=name, media_type=media, data=content)
    writer.finish()


def definition(kind: str) -> bytes:
    """The text of a message type with all that it is made of, as ``ros2msg``."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    for name, own in schema.NAV2_MSGS.items() if kind in schema.NAV2_MSGS else ():
        store.register(get_types_from_msg(own, name))
    text: str = store.generate_msgdef(kind, ros_version=2)[0]
    return text.encode()


def _truth_columns(truth: Trajectory | None) -> PoseColumns | None:
    if truth is None:
        return None
    return planar_poses(truth.stamps, np.arange(len(truth.stamps)), truth.poses, truth.frame, schema.TRUE_FRAME)
