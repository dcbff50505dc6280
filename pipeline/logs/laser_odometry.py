"""Writes a log's messages with the odometry of its laser beside them, for RViz, Foxglove and other people's tools."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline import __version__
from pipeline.geometry import between
from pipeline.logs import cdr, schema
from pipeline.logs.columns import planar_poses
from pipeline.logs.encode import odometry_messages
from pipeline.logs.mcap_file import McapFile
from pipeline.logs.messages import Log
from pipeline.logs.writer import definition
from pipeline.outputs import replacing


def write_with_laser_odometry(
    path: Path, log: Log, poses: NDArray[np.float64], about: Mapping[str, str] | None = None
) -> None:
    """Copies the .mcap of ``log`` to ``path`` as it is, and adds ``poses`` (n, 3) of its scans on /laser_odom.

    The poses are of the robot in the frame of its odometry, where both start; their twists are the motions since the
    scan before, per second. Stamps and log times are those of the scans. What the input had on /laser_odom moves
    below /recorded. ``about``: what the metadata says of them. Raises MclError if the log is not an .mcap or the file
    cannot be written.
    """
    log.check_copied()
    odom, base = _frames(log)
    columns = planar_poses(log.stamps, np.arange(len(log)), poses, odom, base)
    _, _, data = odometry_messages(columns, _twists(log.stamps, poses))
    with McapFile(log.mcap) as source, replacing(path) as partial, partial.open("wb") as file:
        writer = _Copy(file)
        at = _log_times(source, log)
        own = writer.channel(schema.LASER_ODOMETRY, schema.ODOMETRY_TYPE)
        scan = 0
        for kind, channel, message in source.everything():
            while scan < len(data) and at[scan] < message.log_time:
                writer.add(own, at[scan], at[scan], scan, data[scan])
                scan += 1
            to = writer.like(kind, channel)
            writer.add(to, message.log_time, message.publish_time, message.sequence, message.data)
        for k in range(scan, len(data)):
            writer.add(own, at[k], at[k], k, data[k])
        records = {**source.metadata(), schema.LASER_ODOMETRY_ABOUT: {"version": __version__, **(about or {})}}
        writer.finish(records, source)


class _Copy:
    """An .mcap being written, with the channels and types of another one."""

    def __init__(self, file: Any) -> None:
        from mcap.writer import CompressionType, Writer

        self._writer = Writer(file, compression=CompressionType.ZSTD)
        self._writer.start(profile=schema.PROFILE, library=f"mcl-replay/{__version__}")
        self._channels: dict[int, int] = {}
        self._schemas: dict[int, int] = {}

    def channel(self, topic: str, kind: str) -> int:
        """A topic of our own."""
        number = self._writer.register_schema(kind, schema.SCHEMA_ENCODING, definition(kind))
        about = {"offered_qos_profiles": schema.qos_profile(topic)}
        made: int = self._writer.register_channel(topic, schema.MESSAGE_ENCODING, number, about)
        return made

    def like(self, kind: Any, channel: Any) -> int:
        """The same channel of the input, here."""
        if channel.id not in self._channels:
            number = 0
            if kind is not None:
                if kind.id not in self._schemas:
                    self._schemas[kind.id] = self._writer.register_schema(kind.name, kind.encoding, kind.data)
                number = self._schemas[kind.id]
            topic = channel.topic
            if topic == schema.LASER_ODOMETRY:
                topic = schema.RECORDED + topic
            self._channels[channel.id] = self._writer.register_channel(
                topic, channel.message_encoding, number, dict(channel.metadata)
            )
        return self._channels[channel.id]

    def add(self, channel: int, log_time: int, publish_time: int, sequence: int, data: bytes) -> None:
        self._writer.add_message(channel, log_time=log_time, publish_time=publish_time, sequence=sequence, data=data)

    def finish(self, metadata: Mapping[str, Mapping[str, str]], source: McapFile) -> None:
        """Ends the file with ``metadata``, and the attachments of the input."""
        for name, record in metadata.items():
            self._writer.add_metadata(name, dict(record))
        for a in source.attachments():
            self._writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)
        self._writer.finish()


def _frames(log: Log) -> tuple[str, str]:
    """The frames of the odometry and of the robot, as the log names them; our own names where it has no odometry."""
    named = log.metadata.get(schema.READER, {}).get("frames", "").split(" -> ")
    odom, base = (named[0], named[1]) if len(named) == 3 else ("", "")
    return odom or schema.ODOM_FRAME, base or schema.BASE_FRAME


def _log_times(source: McapFile, log: Log) -> list[int]:
    """When every scan was written down, ns: recorders have clocks of their own."""
    topic = log.metadata[schema.READER]["scan_topic"]
    scans = source.messages([topic])[topic]
    stamps = map(cdr.stamp_of, scans.data)
    times = dict(reversed(list(zip(stamps, scans.log_times.tolist(), strict=True))))  # of two with a stamp the first
    return [times.get(stamp, stamp) for stamp in log.stamps.tolist()]


def _twists(stamps: NDArray[np.int64], poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Motions since the scan before, per second, in the robot's frame: (n, 3) m/s, m/s, rad/s; zeros for the first."""
    twists = np.zeros_like(poses)
    seconds = np.diff(stamps) / 1e9
    moved = between(poses[:-1], poses[1:])
    np.divide(moved, seconds[:, None], out=twists[1:], where=seconds[:, None] > 0)
    return twists
