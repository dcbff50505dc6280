"""A bag of ROS 1 (.bag) as a recording: by its index through rosbags, or, where it has none, chunk by chunk.

A bag has no index until it is closed: that of a recorder that was killed (.bag.active) is read as far as it goes.
"""

from __future__ import annotations

import bz2
import heapq
import struct
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from pipeline.errors import MclError
from pipeline.logs import ros1, schema
from pipeline.logs.recorded import Messages, Topic, check_complete, counted

_FIRST_LINE = len(b"#ROSBAG V2.0\n")
_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7  # kinds of records


class Ros1Bag:
    """A .bag opened for reading; a context manager. Raises MclError if it is damaged, where nothing can be read."""

    def __init__(self, path: Path) -> None:
        from rosbags.rosbag1 import Reader

        self.path = Path(path)
        self.remarks: list[str] = []
        self._reader: Any = None
        self._scanned: _Scanned | None = None
        try:
            with self._damage():
                reader = Reader(self.path)
                reader.open()
                self._reader = reader
        except MclError as error:
            self._scanned = _scan(self.path)
            if not self._scanned.times:
                raise
            share = 100 * self._scanned.lost / max(self.path.stat().st_size, 1)
            lost = f"its last {self._scanned.lost:,} bytes ({share:.1f} %) are in no whole chunk"
            self.remarks.append(f"{error.message}; read without its index, as far as it goes: {lost}")

    def __enter__(self) -> Ros1Bag:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._reader is not None:
            self._reader.close()

    @cached_property
    def topics(self) -> dict[str, Topic]:
        """What there is, by name, with the types of ROS 2, as which the messages are handed out."""
        found: dict[str, Topic] = {}
        if self._scanned is not None:
            each = [(c.topic, c.type, self._scanned.counts[key]) for key, c in self._scanned.connections.items()]
        else:
            each = [(c.topic, c.msgtype, c.msgcount) for c in self._reader.connections]
        for name, kind, count in each:
            before = found[name].count if name in found else 0
            found[name] = Topic(name, ros1.type_in_ros2(kind), schema.MESSAGE_ENCODING, before + count)
        return found

    def messages(self, names: Collection[str]) -> dict[str, Messages]:
        """All messages of the topics named; their sequences count them."""
        found: dict[str, tuple[list[int], list[bytes]]] = {}
        with self._damage():
            for name, kind, definition, time, data in self._in_order(names):
                times, contents = found.setdefault(name, ([], []))
                times.append(time)
                contents.append(ros1.as_ros2(data, kind, definition))
        check_complete(self.path, self.topics, names, found)
        return counted(self.topics, found)

    def _in_order(self, names: Collection[str]) -> Iterator[tuple[str, str, str, int, bytes]]:
        if self._scanned is not None:
            connections = self._scanned.connections
            for key, time, data in zip(self._scanned.keys, self._scanned.times, self._scanned.data, strict=True):
                if connections[key].topic in names:
                    yield connections[key].topic, connections[key].type, connections[key].definition, time, data
            return
        wanted = [c for c in self._reader.connections if c.topic in names]
        if not wanted:
            return
        # rosbags sorts by time, which is not the order of the file where a clock was set back.
        places = heapq.merge(*(self._reader.indexes[c.id] for c in wanted))
        read = zip(places, self._reader.messages(connections=wanted), strict=True)
        placed = [((place.chunk_pos, place.offset), connection, time, data) for place, (connection, time, data) in read]
        for _, connection, time, data in sorted(placed, key=lambda each: each[0]):
            if connection.topic not in names:  # an index that leads to somebody else's message
                raise MclError("this bag is damaged: its index is wrong", path=self.path)
            yield connection.topic, connection.msgtype, connection.msgdef.data, time, bytes(data)

    @contextmanager
    def _damage(self) -> Iterator[None]:
        """Whatever the library stumbles over inside a bag is damage to it: it says so in many ways."""
        try:
            yield
        except MclError:
            raise
        except Exception as error:
            said = " ".join(str(error).split())[:120] or type(error).__name__
            raise MclError(f"this bag is cut or damaged: {said}", path=self.path) from error


@dataclass(frozen=True)
class _Connection:
    topic: str
    type: str
    definition: str


@dataclass(frozen=True)
class _Scanned:
    """What the whole chunks of a bag hold, in the order of the file; ``lost``: bytes after the last of them."""

    connections: dict[int, _Connection]
    keys: list[int]
    times: list[int]
    data: list[bytes]
    lost: int

    @cached_property
    def counts(self) -> dict[int, int]:
        keys, counts = np.unique(self.keys, return_counts=True)
        return dict.fromkeys(self.connections, 0) | dict(zip(keys.tolist(), counts.tolist(), strict=True))


def _scan(path: Path) -> _Scanned:
    content = path.read_bytes()
    found = _Scanned({}, [], [], [], 0)
    whole = _FIRST_LINE
    try:
        for fields, data, end in _records(content, _FIRST_LINE):
            if _kind(fields) == _CHUNK:
                for inner, body, _ in _records(_opened(fields, data), 0):
                    _note(found, inner, body)
            else:
                _note(found, fields, data)
            whole = end
    except (struct.error, ValueError, LookupError, OSError, EOFError, RuntimeError, UnicodeDecodeError):
        pass  # the end of what can be read
    return _Scanned(found.connections, found.keys, found.times, found.data, len(content) - whole)


def _note(found: _Scanned, fields: dict[bytes, bytes], data: bytes) -> None:
    if _kind(fields) == _CONNECTION:
        about = _fields(data)
        key = struct.unpack("<I", fields[b"conn"])[0]
        kind, definition = about[b"type"].decode(), about[b"message_definition"].decode(errors="replace")
        found.connections[key] = _Connection(fields[b"topic"].decode(), kind, definition)
    elif _kind(fields) == _MESSAGE:
        seconds, nanoseconds = struct.unpack("<II", fields[b"time"])
        key = struct.unpack("<I", fields[b"conn"])[0]
        if key in found.connections:
            found.keys.append(key)
            found.times.append(seconds * 1_000_000_000 + nanoseconds)
            found.data.append(data)


def _records(content: bytes, at: int) -> Iterator[tuple[dict[bytes, bytes], bytes, int]]:
    """Fields, data and end of every whole record."""
    while at + 4 <= len(content):
        (size,) = struct.unpack_from("<I", content, at)
        fields = _fields(content[at + 4 : at + 4 + size])
        at += 4 + size
        (size,) = struct.unpack_from("<I", content, at)
        at += 4 + size
        if at > len(content):
            raise EOFError
        yield fields, content[at - size : at], at


def _fields(header: bytes) -> dict[bytes, bytes]:
    found, at = {}, 0
    while at < len(header):
        (size,) = struct.unpack_from("<I", header, at)
        name, _, value = header[at + 4 : at + 4 + size].partition(b"=")
        found[name] = value
        at += 4 + size
    return found


def _kind(fields: dict[bytes, bytes]) -> int:
    return fields[b"op"][0]


def _opened(fields: dict[bytes, bytes], data: bytes) -> bytes:
    if fields[b"compression"] == b"bz2":
        return bz2.decompress(data)
    if fields[b"compression"] == b"lz4":
        from lz4.frame import decompress

        return bytes(decompress(data))
    return data
