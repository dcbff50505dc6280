"""Raw access to an .mcap: which topics it has, their messages as bytes, its metadata and attachments."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from struct import Struct
from types import TracebackType
from typing import Any, Final

import numpy as np

from pipeline.errors import MclError
from pipeline.logs import ros1
from pipeline.logs.recorded import Messages, Topic, check_complete
from pipeline.logs.schema import MESSAGE_ENCODING

_RECORD_HEAD: Final = Struct("<BQ")  # kind and length of every record
MAGIC: Final = b"\x89MCAP0\r\n"
ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"
RRD_MAGIC: Final = b"RRF"
A_RUN: Final = ("this is a run, and a log is wanted", "give the .mcap that the run was made from")


class McapFile:
    """An .mcap opened for reading; a context manager. Messages of ROS 1 in it are handed out as ROS 2's.

    A file that is cut, for the recorder was killed, is read as far as it goes; ``remarks`` say so. Raises MclError if
    the file is missing, empty, no MCAP or damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self.remarks: list[str] = []
        try:
            self._file = self.path.open("rb")
        except FileNotFoundError as error:
            raise MclError("no such file", path=path) from error
        except IsADirectoryError as error:
            if any(self.path.glob("*.rrd")):
                raise MclError(*A_RUN, path=path) from error
            raise MclError(
                "cannot be read: a directory, not an .mcap", "a bag? then: mcl convert", path=path
            ) from error
        except OSError as error:
            raise MclError(f"cannot be read: {error.strerror}", path=path) from error
        try:
            self._cut = not self._check_ends()
            if self._cut:
                self.remarks.append(self._lost())
            with self._damage():
                self._indexed = False
                self._definitions: dict[str, tuple[str, str]] = {}  # of topics by ROS 1: type and text
                self.topics = {topic.name: topic for topic in self._find_topics()}
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> McapFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @property
    def ros1_topics(self) -> list[str]:
        """The topics whose messages are ROS 1's."""
        return list(self._definitions)

    def messages(self, names: Collection[str]) -> dict[str, Messages]:
        """All messages of the topics named that the file has; topics without messages are left out."""
        found: dict[str, tuple[list[int], list[int], list[bytes]]] = {}
        with self._damage():
            for _, channel, message in self._messages(list(names)):
                if (
                    channel.topic not in found
                ):  # which several may publish: their messages stay in the order of the file
                    found[channel.topic] = ([], [], [])
                times, sequences, data = found[channel.topic]
                times.append(message.log_time)
                sequences.append(message.sequence)
                content = unpacked(message.data)
                if channel.message_encoding == ros1.ENCODING:
                    content = self._as_ros2(content, channel.topic)
                data.append(content)
            result = {
                name: Messages(self.topics[name], np.array(times, np.int64), np.array(sequences, np.int64), data)
                for name, (times, sequences, data) in found.items()
            }
        check_complete(self.path, self.topics, names, result)
        return result

    def everything(self) -> Iterator[tuple[Any, Any, Any]]:
        """Every message in the order of log times: its schema record (or None), channel record and message record."""
        with self._damage():
            for schema, channel, message in self._messages(None, log_time_order=True):
                message.data = unpacked(message.data)
                yield schema, channel, message

    def attachments(self) -> Iterator[Any]:
        """The attachment records."""
        if self._cut:
            return
        with self._damage():
            yield from self._reader().iter_attachments()

    def metadata(self) -> dict[str, dict[str, str]]:
        """The metadata records by name."""
        if self._cut:
            return {}
        with self._damage():
            return {record.name: dict(record.metadata) for record in self._reader().iter_metadata()}

    def attachment(self, name: str) -> bytes | None:
        """The content of the attachment of that name, None if there is none."""
        with self._damage():
            for attachment in self.attachments():
                if attachment.name == name:
                    content: bytes = attachment.data
                    return content
        return None

    def _find_topics(self) -> list[Topic]:
        from mcap.reader import SeekingReader

        channels: dict[int, Any] = {}
        schemas: dict[int, Any] = {}
        counts: dict[int, int] = {}
        summary = None if self._cut else SeekingReader(self._file).get_summary()
        statistics = summary.statistics if summary is not None else None
        if summary is not None and statistics is not None and statistics.channel_count == len(summary.channels):
            self._indexed = True
            channels, schemas, counts = summary.channels, summary.schemas, statistics.channel_message_counts
        else:  # a summary is optional, and so is all that is in it: then only reading everything tells what is there
            for schema, channel, _ in self._messages(None):
                channels[channel.id] = channel
                counts[channel.id] = counts.get(channel.id, 0) + 1
                if schema is not None:
                    schemas[schema.id] = schema
        topics: dict[str, Topic] = {}
        for number, channel in channels.items():
            kind = schemas[channel.schema_id].name if channel.schema_id in schemas else ""
            before = topics[channel.topic].count if channel.topic in topics else 0
            count = before + counts.get(number, 0)
            encoding = channel.message_encoding
            if encoding == ros1.ENCODING and kind:
                self._definitions[channel.topic] = (kind, schemas[channel.schema_id].data.decode(errors="replace"))
                kind, encoding = ros1.type_in_ros2(kind), MESSAGE_ENCODING
            topics[channel.topic] = Topic(channel.topic, kind, encoding, count)
        return list(topics.values())

    def _reader(self) -> Any:
        """A reader from the beginning: by the index if the file has one, else straight through."""
        from mcap.reader import NonSeekingReader, SeekingReader

        self._file.seek(0)
        return (SeekingReader if self._indexed else NonSeekingReader)(self._file, validate_crcs=True)

    def _messages(self, topics: list[str] | None, log_time_order: bool = False) -> Iterator[tuple[Any, Any, Any]]:
        """Messages in the order of the file, or of their log times; of a file that is cut those that are whole."""
        read = self._reader().iter_messages(topics=topics, log_time_order=log_time_order and not self._cut)
        if not self._cut:
            yield from read
            return
        found = []
        try:
            for message in read:
                found.append(message)
        except Exception:  # the end, told by whatever the library stumbles over
            pass
        yield from sorted(found, key=lambda each: int(each[2].log_time)) if log_time_order else found

    def _as_ros2(self, data: bytes, topic: str) -> bytes:
        kind, text = self._definitions[topic]
        try:
            return ros1.as_ros2(data, kind, text)
        except Exception as error:  # rosbags raises whatever its generated code stumbles over
            said = " ".join(str(error).split())[:80] or type(error).__name__
            raise MclError(f"{topic}: a message is no {kind}: {said}", path=self.path) from error

    def _lost(self) -> str:
        """How much of a file that is cut no longer counts: all after its last whole record."""
        size = self._file.seek(0, 2)
        whole = len(MAGIC)
        while whole + _RECORD_HEAD.size <= size:
            self._file.seek(whole)
            kind, length = _RECORD_HEAD.unpack(self._file.read(_RECORD_HEAD.size))
            if kind == 0 or whole + _RECORD_HEAD.size + length > size:
                break
            whole += _RECORD_HEAD.size + length
        lost = size - whole
        return (
            f"this MCAP file is cut: its end is missing, and of its {size:,} bytes the last {lost:,} "
            f"({100 * lost / size:.1f} %) are in no whole chunk; read as far as it goes"
        )

    def _check_ends(self) -> bool:
        """Whether the file has its end as well; its beginning it must have."""
        begin = self._file.read(len(MAGIC))
        if not begin:
            raise MclError("this file is empty", path=self.path)
        if begin.startswith(ZSTD_MAGIC):
            raise MclError(
                "this file is packed with zstd", "unpack it, or: mcl convert the bag's folder", path=self.path
            )
        if begin.startswith(RRD_MAGIC):
            raise MclError(*A_RUN, path=self.path)
        if begin != MAGIC:
            raise MclError("not an MCAP file", "logs and bags become one with: mcl convert", path=self.path)
        self._file.seek(-len(MAGIC), 2)
        whole = self._file.tell() > 0 and self._file.read() == MAGIC
        self._file.seek(0)
        return whole

    @contextmanager
    def _damage(self) -> Iterator[None]:
        """Whatever the library stumbles over inside a file whose ends are right is damage to it.

        That may be anything: a wrong length is a MemoryError, a wrong channel a KeyError.
        """
        try:
            yield
        except MclError:
            raise
        except Exception as error:
            said = " ".join(str(error).split())[:80] or type(error).__name__
            raise MclError(f"this MCAP file is damaged: {said}", path=self.path) from error


def unpacked(data: bytes) -> bytes:
    """The message itself: rosbag2 can pack each of them with zstd, and says so only in another file."""
    if not data.startswith(ZSTD_MAGIC):  # CDR begins with a zero
        return data
    from zstandard import ZstdDecompressor

    result: bytes = ZstdDecompressor().decompressobj().decompress(data)
    return result
