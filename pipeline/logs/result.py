"""Writes what a run found beside what it was found from: one .mcap that RViz, Foxglove and nav2's tools show.

The input's messages are copied as they are, at their own log times; the result's have the stamps of the scans, and the
log times of the scans, so that both play together whatever clock the recorder had. Topics are in ``schema``. Only
where the odometry was drawn beside the map is left out: it has its place in the map now.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline import __version__
from pipeline.errors import MclError
from pipeline.geometry import compose, inverse, yaw_to_quaternion
from pipeline.logs import cdr, schema
from pipeline.logs.choice import find
from pipeline.logs.columns import PoseColumns
from pipeline.logs.encode import map_message
from pipeline.logs.mcap_file import McapFile
from pipeline.logs.messages import Log
from pipeline.logs.odometry import odometry_at
from pipeline.logs.reader import own_map
from pipeline.logs.transforms import Transforms, moved
from pipeline.logs.writer import definition, pack_grid
from pipeline.outputs import told

Key = tuple[str, str, str]
LEVELS = {"found": 0, "off the map": 0, "ambiguous": 1, "lost": 2}
"""Of diagnostic_msgs/DiagnosticStatus: OK, WARN, ERROR."""


class ResultFile:
    """An .mcap on its way, a context manager: it appears under its name when the run is over, or not at all.

    ``about``: what its metadata says of the run. Raises MclError if the file exists, or the log is not an .mcap.
    """

    def __init__(self, path: Path, log: Log, about: Mapping[str, str] | None = None) -> None:
        self.path = Path(path)
        if self.path.exists():
            raise MclError("this file exists already", "results are never overwritten", path=path)
        log.check_copied()
        self._log, self._about = log, {"version": __version__, **(about or {})}
        self._odom, self._base, _ = log.metadata[schema.READER]["frames"].split(" -> ")
        self._partial = self.path.with_name(f".{self.path.name}.{os.getpid()}.part")
        self._source = McapFile(log.mcap)
        try:
            self._prepare()
            with told(self.path):
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self._file = self._partial.open("wb")
        except BaseException:
            self._source.close()
            raise
        self._writer = _writer(self._file)
        self._channels: dict[Key, int] = {}
        self._schemas: dict[tuple[str, str], int] = {}
        self._input = self._source.everything()
        self._next = next(self._input, None)

    def __enter__(self) -> ResultFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is None:
                self._finish()
                self._file.close()
                self._partial.replace(self.path)
        finally:
            self._file.close()
            self._source.close()
            with suppress(OSError):
                self._partial.unlink(missing_ok=True)

    def write(
        self,
        scan: int,
        pose: NDArray[np.float64],
        covariance: NDArray[np.float64],
        particles: NDArray[np.float32],
        weights: NDArray[np.float64],
    ) -> None:
        """Adds what one scan led to, in the map: ``pose`` (3,) with ``covariance`` (3, 3), ``particles`` (n, 3) and
        their ``weights`` (n,)."""
        stamp = int(self._log.stamps[scan])
        at = self._log_times.get(stamp, stamp)
        self._copy_until(at)
        links = [(self._map, self._odom, compose(pose, inverse(self._odometry[scan])))]
        if not self._connected:
            links.append((self._odom, self._base, self._odometry[scan]))
        for frame, child, place in links:
            self._add(schema.TF, schema.TF_TYPE, at, scan, _transform(stamp, frame, child, place))
        cloud = _poses(particles, weights)
        for topic, data in (
            (schema.AMCL_POSE, _pose(stamp, self._map, pose, covariance)),
            (schema.PARTICLE_CLOUD, cdr.pack_sequence(stamp, self._map, cloud)),
            (schema.POSE_ARRAY, cdr.pack_sequence(stamp, self._map, cloud[:, :7])),
        ):
            self._add(topic, schema.RESULT_TYPES[topic], at, scan, data)

    def diagnose(self, scan: int, verdict: str, values: Mapping[str, str]) -> None:
        """Adds the verdict on a scan as monitors show it, with ``values`` that say why."""
        stamp = int(self._log.stamps[scan])
        at = self._log_times.get(stamp, stamp)
        data = cdr.pack_diagnostics(stamp, LEVELS[verdict], "mcl: localization", verdict, values)
        self._add(schema.DIAGNOSTICS, schema.RESULT_TYPES[schema.DIAGNOSTICS], at, scan, data)

    def _prepare(self) -> None:
        """What has to be known of the input: its clock, its transforms, its map."""
        source, log = self._source, self._log
        topic = log.metadata[schema.READER]["scan_topic"]
        scans = source.messages([topic])[topic]
        clocks = list(
            zip(map(cdr.stamp_of, scans.data), scans.log_times.tolist(), scans.sequences.tolist(), strict=True)
        )
        self._log_times = {stamp: at for stamp, at, _ in reversed(clocks)}  # of two with one stamp, the first
        numbers = {stamp: number for stamp, _, number in reversed(clocks)}
        transforms = Transforms(source)
        links = {**transforms.moving, **transforms.static}
        self._adopted = self._odom in links  # somebody else says where odom is: AMCL, while it was recorded
        on_tf = _along(transforms, self._odom, self._base)
        self._connected, self._odometry = on_tf is not None, log.odometry
        if on_tf is not None:  # the one that a viewer will put behind map -> odom
            sequences = np.array([numbers.get(stamp, 0) for stamp in log.stamps.tolist()])
            poses, inside = odometry_at(log.stamps, sequences, on_tf)
            self._odometry = np.where(inside[:, None], poses, log.odometry)
        own = own_map(source)
        assert log.grid is not None
        self._other_map = self._map_due = own is None or own.sha256 != log.grid.sha256
        topic_of_map = find(source, schema.GRID_TYPE)
        self._map = schema.MAP_FRAME
        if topic_of_map is not None and not self._other_map:
            self._map = cdr.frame_of(source.messages([topic_of_map])[topic_of_map].data[-1]) or self._map

    def _copy_until(self, time: float) -> None:
        """Passes the input's messages on that were logged up to then, and before the first the map, if it is new."""
        if self._map_due and self._log.grid is not None and self._next is not None:
            stamp, self._map_due = int(self._log.stamps[0]), False
            (data,) = map_message(self._log.grid, stamp)[2]
            self._add(schema.MAP, schema.GRID_TYPE, self._next[2].log_time, 0, data)
        while self._next is not None and self._next[2].log_time <= time:
            self._copy(*self._next)
            self._next = next(self._input, None)

    def _copy(self, kind: Any, channel: Any, message: Any) -> None:
        topic, name = channel.topic, "" if kind is None else kind.name
        if topic == schema.VIEW_TF:
            return
        if topic in schema.RESULT_TYPES or (topic == schema.MAP and self._other_map):
            topic = schema.RECORDED + topic
        to = self._channel(topic, name, channel, kind)
        parts = [(to, message.data)]
        if self._adopted and name == schema.TF_TYPE and channel.message_encoding == schema.MESSAGE_ENCODING:
            kept, others = _without_parent_of(self._odom, message.data)
            elsewhere = self._channel(schema.RECORDED + topic, name, channel, kind) if others else to
            parts = [(c, data) for c, data in ((to, kept), (elsewhere, others)) if data is not None]
        for into, data in parts:
            times = {"log_time": message.log_time, "publish_time": message.publish_time}
            self._writer.add_message(into, data=data, sequence=message.sequence, **times)

    def _add(self, topic: str, kind: str, at: int, sequence: int, data: bytes) -> None:
        channel = self._channel(topic, kind)
        self._writer.add_message(channel, log_time=at, publish_time=at, sequence=sequence, data=data)

    def _channel(self, topic: str, kind: str, channel: Any = None, record: Any = None) -> int:
        """Where to write messages of a topic: like a channel of the input, or by the contract in ``schema``."""
        encoding = schema.MESSAGE_ENCODING if channel is None else channel.message_encoding
        key = (topic, kind, encoding)
        if key not in self._channels:
            number = 0
            if channel is None:
                number = self._schema(kind, schema.SCHEMA_ENCODING, None)
            elif record is not None:
                number = self._schema(kind, record.encoding, record.data)
            meta = {"offered_qos_profiles": schema.qos_profile(topic)} if channel is None else dict(channel.metadata)
            self._channels[key] = self._writer.register_channel(topic, encoding, number, meta)
        return self._channels[key]

    def _schema(self, kind: str, encoding: str, text: bytes | None) -> int:
        key = (kind, encoding)
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(
                kind, encoding, definition(kind) if text is None else text
            )
        return self._schemas[key]

    def _finish(self) -> None:
        self._copy_until(float("inf"))
        grid = self._log.grid
        metadata = {
            k: v for k, v in self._source.metadata().items() if not (k == schema.MAP_SOURCE and self._other_map)
        }
        for name, record in (metadata | {schema.RESULT: self._about}).items():
            self._writer.add_metadata(name, record)
        for a in self._source.attachments():
            if not (a.name == schema.MAP_CELLS and self._other_map):
                self._writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)
        if self._other_map and grid is not None:
            start = int(self._log.stamps[0])
            self._writer.add_attachment(0, start, schema.MAP_CELLS, "application/octet-stream", pack_grid(grid))
        self._writer.finish()


def _writer(file: Any) -> Any:
    from mcap.writer import CompressionType, Writer

    writer = Writer(file, compression=CompressionType.ZSTD)
    writer.start(profile=schema.PROFILE, library=f"mcl-replay/{__version__}")
    return writer


def _along(transforms: Transforms, odom: str, base: str) -> PoseColumns | None:
    """The transforms that lead from odom to base, as one; None if they do not."""
    child = transforms.base_below(odom, base)
    if child is None:
        return None
    link = {**transforms.moving, **transforms.static}[child]
    place = transforms.place(base, child, odom)
    if place is None:
        return None
    return link if child == base else moved(link, base, place)


def _transform(stamp: int, frame: str, child: str, place: NDArray[np.float64]) -> bytes:
    rows = cdr.blank(1, cdr.ONE_TRANSFORM, frame_id=frame, child_frame_id=child)
    rows["transforms"] = 1
    return _placed(rows, stamp, place)


def _pose(stamp: int, frame: str, pose: NDArray[np.float64], covariance: NDArray[np.float64]) -> bytes:
    rows = cdr.blank(1, cdr.POSE_WITH_COVARIANCE, frame_id=frame)
    whole = np.zeros((6, 6))  # of x, y, z, and of turns about them
    whole[np.ix_((0, 1, 5), (0, 1, 5))] = covariance
    rows["covariance"] = whole.reshape(-1)
    return _placed(rows, stamp, pose)


def _placed(rows: cdr.Rows, stamp: int, pose: NDArray[np.float64]) -> bytes:
    cdr.set_stamps(rows, np.array([stamp]))
    rows["position"] = (pose[0], pose[1], 0.0)
    rows["orientation"] = yaw_to_quaternion(float(pose[2]))
    return cdr.pack(rows)[0]


def _poses(particles: NDArray[np.float32], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 8): position, orientation and weight of every particle, with no more digits than the particle has."""
    items = np.zeros((len(particles), 8), np.float32)
    items[:, :2] = particles[:, :2]
    items[:, 5], items[:, 6] = np.sin(particles[:, 2] / 2), np.cos(particles[:, 2] / 2)
    items[:, 7] = weights
    return items.astype(np.float64)


def _without_parent_of(odom: str, data: bytes) -> tuple[bytes | None, bytes | None]:
    """A TFMessage without the transforms that say where ``odom`` is, and one of those; None where nothing is left."""
    from pipeline.logs.decode import typestore

    message = typestore().deserialize_cdr(data, schema.TF_TYPE)

    def chosen(adopted: bool) -> bytes | None:
        some = [t for t in message.transforms if (t.child_frame_id.lstrip("/") == odom) is adopted]
        return bytes(typestore().serialize_cdr(type(message)(some), schema.TF_TYPE)) if some else None

    return chosen(False), chosen(True)
