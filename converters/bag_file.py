"""A bag of ROS 1 (.bag) or ROS 2 (a folder, or its .db3) as a recording: its messages as ROS 2 serialises them."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from pipeline.errors import MclError
from pipeline.logs import schema
from pipeline.logs.recorded import Messages, Topic, check_complete

ROS1_MAGIC, SQLITE_MAGIC = b"#ROSBAG V2.0", b"SQLite format 3\0"
METADATA = "metadata.yaml"
RENAMED = {"tf/msg/tfMessage": schema.TF_TYPE}
"""Types that ROS 2 has under another name, with the same content."""


def is_bag(path: Path, head: bytes) -> bool:
    """Whether a file whose first bytes are ``head``, or a folder, is a bag."""
    return (path / METADATA).is_file() if path.is_dir() else head.startswith((ROS1_MAGIC, SQLITE_MAGIC))


class BagFile:
    """A bag opened for reading through rosbags; a context manager. Raises MclError if it is cut or damaged."""

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        with self._damage():
            with self.path.open("rb") if self.path.is_file() else _nothing() as file:
                self._ros1 = file is not None and file.read(len(ROS1_MAGIC)) == ROS1_MAGIC
            if self._ros1:
                from rosbags.rosbag1 import Reader as Reader1

                self._reader: Any = Reader1(self.path)
            else:
                from rosbags.rosbag2 import Reader as Reader2

                self._reader = Reader2(self.path)
            self._reader.open()

    def __enter__(self) -> BagFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._reader.close()

    @cached_property
    def topics(self) -> dict[str, Topic]:
        """What there is, by name; what ROS 1 serialised counts as ROS 2's, for so it is handed out."""
        found: dict[str, Topic] = {}
        for connection in self._reader.connections:
            before = found[connection.topic].count if connection.topic in found else 0
            encoding = schema.MESSAGE_ENCODING if self._ros1 else connection.ext.serialization_format
            kind = RENAMED.get(connection.msgtype, connection.msgtype)
            found[connection.topic] = Topic(connection.topic, kind, encoding, before + connection.msgcount)
        return found

    def messages(self, names: Collection[str]) -> dict[str, Messages]:
        """All messages of the topics named, in the order of the bag; their sequences count them."""
        wanted = [c for c in self._reader.connections if c.topic in names]
        found: dict[str, tuple[list[int], list[bytes]]] = {}
        with self._damage():
            for connection, time, data in self._reader.messages(connections=wanted) if wanted else ():
                times, contents = found.setdefault(connection.topic, ([], []))
                times.append(time)
                contents.append(self._as_ros2(bytes(data), connection))
        check_complete(self.path, self.topics, names, found)
        return {
            name: Messages(self.topics[name], np.array(times, dtype=np.int64), np.arange(len(times)), contents)
            for name, (times, contents) in found.items()
        }

    def _as_ros2(self, data: bytes, connection: Any) -> bytes:
        if not self._ros1:
            return data
        ros1, ros2 = self._typestores
        kind = connection.msgtype
        if kind not in ros1.fielddefs:  # not of the standard ones: the bag brings its definition along
            from rosbags.typesys import get_types_from_msg

            types = get_types_from_msg(connection.msgdef.data, kind)
            ros1.register({name: fields for name, fields in types.items() if name not in ros1.fielddefs})
        return bytes(ros2.serialize_cdr(ros1.deserialize_ros1(data, kind), RENAMED.get(kind, kind)))

    @cached_property
    def _typestores(self) -> tuple[Any, Any]:
        from rosbags.typesys import Stores, get_typestore

        return get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)

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


@contextmanager
def _nothing() -> Iterator[None]:
    yield None
