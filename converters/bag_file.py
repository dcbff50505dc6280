"""A recording of whatever kind, opened: an .mcap, a bag of ROS 1 (.bag), a .db3 of ROS 2, or a bag's folder.

A folder is what lies in it, its files in the order of their numbers: metadata.yaml is only asked what is missing.
"""

from __future__ import annotations

import os
import re
import shutil
import sqlite3
import tempfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any
from urllib.parse import quote

import numpy as np

from converters.ros1_bag import Ros1Bag
from pipeline.errors import MclError
from pipeline.logs.mcap_file import A_RUN, ZSTD_MAGIC, McapFile, unpacked
from pipeline.logs.recorded import Messages, Topic, check_complete, counted

ROS1_MAGIC, SQLITE_MAGIC = b"#ROSBAG V2.0", b"SQLite format 3\0"
METADATA = "metadata.yaml"

_KINDS = (".mcap", ".db3", ".bag", ".mcap.zstd", ".db3.zstd")
_LONGEST = 1 << 40  # bytes that the header of a .db3 may promise
_NUMBER = re.compile(r"_?(\d+)$")


def is_bag(path: Path, head: bytes) -> bool:
    """Whether a file whose first bytes are ``head``, or a folder, is a bag.

    A folder is one if it has a metadata.yaml, or if the recordings in it have one name but for their numbers.
    """
    if not path.is_dir():
        return head.startswith((ROS1_MAGIC, SQLITE_MAGIC, ZSTD_MAGIC))
    if any(path.glob("*.rrd")):
        return False
    return (path / METADATA).is_file() or len({_series(part)[0] for part in _parts(path)}) == 1


def open_recording(path: Path) -> Any:
    """The recording in a file or a folder, a context manager (``recorded.Recorded``).

    Raises MclError if it is missing, none, or damaged.
    """
    if path.is_dir():
        if any(path.glob("*.rrd")):
            raise MclError(*A_RUN, path=path)
        return BagFolder(path)
    head = b""
    if path.is_file():
        with path.open("rb") as file:
            head = file.read(64)
    if head.startswith(ROS1_MAGIC):
        return Ros1Bag(path)
    if head.startswith(ZSTD_MAGIC):
        return BagFolder(path)
    return SqliteBag(path) if head.startswith(SQLITE_MAGIC) else McapFile(path)


class BagFolder:
    """The folder of a bag of ROS 2, its parts one after the other, or a part packed whole; a context manager."""

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self._stack = ExitStack()
        parts = _parts(self.path) if self.path.is_dir() else [self.path]
        if not parts:
            raise MclError("no recording (.mcap, .db3) lies in this folder", path=path)
        try:
            self._files = [self._opened(part) for part in parts]
        except BaseException:
            self._stack.close()
            raise
        self._said = self._missing(metadata(self.path))

    def __enter__(self) -> BagFolder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    @property
    def remarks(self) -> list[str]:
        """What a user should know of how the parts were read, and of parts that are not there."""
        several = len(self._files) > 1
        said = [(f"{file.path.name}: " if several else "", text) for file in self._files for text in file.remarks]
        return self._said + [name + text for name, text in said]

    @cached_property
    def topics(self) -> dict[str, Topic]:
        """What there is in all parts together, by name."""
        found: dict[str, Topic] = {}
        for topic in (topic for file in self._files for topic in file.topics.values()):
            before = found[topic.name].count if topic.name in found else 0
            found[topic.name] = Topic(topic.name, topic.type, topic.encoding, before + topic.count)
        return found

    def messages(self, names: Collection[str]) -> dict[str, Messages]:
        """All messages of the topics named, in the order of the parts; their sequences count them."""
        parts = [file.messages(names) for file in self._files]
        found = {}
        for name in dict.fromkeys(name for part in parts for name in part):
            some = [part[name] for part in parts if name in part]
            times = np.concatenate([messages.log_times for messages in some])
            data = [content for messages in some for content in messages.data]
            found[name] = Messages(self.topics[name], times, np.arange(len(data)), data)
        return found

    def _opened(self, part: Path) -> Any:
        unpacked = self._unpacked(part)
        try:
            return self._stack.enter_context(open_recording(unpacked))
        except MclError as error:
            packed = "" if unpacked == part else "this file is packed with zstd, and what is in it is none: "
            raise MclError(packed + error.message, error.hint, path=part) from error

    def _unpacked(self, part: Path) -> Path:
        """The part itself, or where its content lies while this is open, if it was packed whole."""
        with part.open("rb") as packed:
            if packed.read(len(ZSTD_MAGIC)) != ZSTD_MAGIC:
                return part
            from zstandard import ZstdDecompressor, ZstdError

            packed.seek(0)
            folder = self._stack.enter_context(tempfile.TemporaryDirectory(prefix="mcl-"))
            path = Path(folder) / part.name.removesuffix(".zstd")
            try:
                with path.open("wb") as file:
                    ZstdDecompressor().copy_stream(packed, file)
            except ZstdError as error:
                raise MclError("this file is packed with zstd, and cut or damaged", path=part) from error
            return path

    def _missing(self, metadata: Mapping[str, Any]) -> list[str]:
        """What metadata.yaml names and nobody finds here."""
        names = [Path(str(name)).name for name in _list(metadata.get("relative_file_paths"))]
        gone = [name for name in names if not (self.path / name).exists()]
        said = [f"{METADATA} names {', '.join(gone)}, which is not here: read without"] if gone else []
        for entry in _list(metadata.get("topics_with_message_count")):
            try:
                name, count = str(entry["topic_metadata"]["name"]), int(entry["message_count"])
            except (KeyError, TypeError, ValueError):
                continue
            here = self.topics[name].count if name in self.topics else 0
            if count > 0 and here == 0:
                said.append(f"{METADATA} promises {count:,} messages on {name}, and none is here")
        return said


class SqliteBag:
    """A .db3 of ROS 2; a context manager. Raises MclError if it is damaged, where nothing of it can be read."""

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self.remarks: list[str] = []
        self._folder = ExitStack()
        # What a recorder that was killed left in its log beside the file counts as well, if there is one.
        logged = self.path.with_name(self.path.name + "-wal").exists()
        file, self._cut = (self.path, False) if logged else self._padded()
        with self._damage():
            self._database = sqlite3.connect(
                f"file:{quote(str(file))}?mode=ro{'' if logged else '&immutable=1'}", uri=True
            )
            try:
                topics = "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
                self._topics = {key: texts for key, *texts in self._database.execute(topics)}
            except BaseException:
                self._database.close()
                self._folder.close()
                raise

    def __enter__(self) -> SqliteBag:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._database.close()
        self._folder.close()

    @cached_property
    def topics(self) -> dict[str, Topic]:
        """What there is, by name."""
        counts = dict.fromkeys(self._topics, 0)
        with self._damage():
            for key, count in self._database.execute(f"SELECT topic_id, count(*) {self._whole} GROUP BY topic_id"):
                counts[key] = count
        found: dict[str, Topic] = {}
        for key, (name, kind, encoding) in self._topics.items():
            before = found[name].count if name in found else 0
            found[name] = Topic(name, kind, encoding, before + counts[key])
        return found

    def messages(self, names: Collection[str]) -> dict[str, Messages]:
        """All messages of the topics named; their sequences count them."""
        wanted = [key for key, (name, _, _) in self._topics.items() if name in names]
        marks = ", ".join("?" * len(wanted))
        question = f"SELECT topic_id, timestamp, data {self._whole} AND topic_id IN ({marks}) ORDER BY id"
        found: dict[str, tuple[list[int], list[bytes]]] = {}
        with self._damage():
            for key, time, data in self._database.execute(question, wanted):
                times, contents = found.setdefault(self._topics[key][0], ([], []))
                times.append(time)
                contents.append(unpacked(data))
        check_complete(self.path, self.topics, names, found)
        return counted(self.topics, found)

    def _padded(self) -> tuple[Path, bool]:
        """The file, or a copy that is as long as it says it is: of a shorter one SQLite reads nothing; and if it is."""
        with self.path.open("rb") as file:
            head = file.read(32)
            size = file.seek(0, 2)
        page = int.from_bytes(head[16:18], "big")
        length = (1 << 16 if page == 1 else page) * int.from_bytes(head[28:32], "big")
        if not size < length <= _LONGEST:
            return self.path, False
        copy = Path(self._folder.enter_context(tempfile.TemporaryDirectory(prefix="mcl-"))) / self.path.name
        shutil.copyfile(self.path, copy)
        os.truncate(copy, length)
        lost = length - size
        self.remarks.append(
            f"this bag is cut or damaged: of its {length:,} bytes the last {lost:,} ({100 * lost / length:.1f} %) are "
            "not there; read as far as it goes"
        )
        return copy, True

    @cached_property
    def _whole(self) -> str:
        """From where rows are to be taken: up to the last one that can be read, if the file is cut."""
        if not self._cut:
            return "FROM messages WHERE true"
        last = -1
        with suppress(sqlite3.DatabaseError):
            for number, data in self._database.execute("SELECT id, data FROM messages ORDER BY id"):
                last = number if isinstance(data, bytes) else last
        return f"FROM messages WHERE id <= {last}"

    @contextmanager
    def _damage(self) -> Iterator[None]:
        try:
            yield
        except (sqlite3.Error, TypeError, ValueError, OverflowError) as error:
            raise MclError(
                f"this bag is cut or damaged: {' '.join(str(error).split())[:120]}", path=self.path
            ) from error


def _parts(folder: Path) -> list[Path]:
    """The recordings in a folder, in the order of their numbers."""
    return sorted((p for p in folder.iterdir() if p.is_file() and p.name.endswith(_KINDS)), key=_series)


def _series(part: Path) -> tuple[str, int, str]:
    """The name that all parts of a bag have, the number of this one, and its whole name."""
    stem = part.name
    for kind in sorted(_KINDS, key=len, reverse=True):
        stem = stem.removesuffix(kind)
    number = _NUMBER.search(stem)
    return (stem, -1, part.name) if number is None else (stem[: number.start()], int(number[1]), part.name)


def metadata(folder: Path) -> Mapping[str, Any]:
    """What metadata.yaml says, as far as it can be read: it is no more than a hint."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    try:
        said = YAML(typ="safe").load((folder / METADATA).read_text(encoding="utf-8"))
        found = said["rosbag2_bagfile_information"]
    except (OSError, UnicodeDecodeError, YAMLError, KeyError, TypeError, ValueError):
        return {}
    return found if isinstance(found, Mapping) else {}


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []
