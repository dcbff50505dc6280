"""What any recording looks like from here, whatever its container: topics, and their ROS 2 messages as bytes."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.geometry import Pose
from pipeline.logs.stretches import numbered
from pipeline.logs.transforms_file import GivenTransform
from pipeline.spelling import did_you_mean

_LISTED = 12  # topics (or transforms) that an error message names


@dataclass(frozen=True)
class Topic:
    """A channel of a recording: its name, message type, message encoding (``cdr`` for ROS 2) and number of messages."""

    name: str
    type: str
    encoding: str
    count: int


@dataclass(frozen=True)
class Messages:
    """The messages of one topic in the order of the file: log times (n,) ns, sequences (n,), and their bytes.

    ``by_log_time``: the log times count, when they were written down, and not the stamps that they carry.
    """

    topic: Topic
    log_times: NDArray[np.int64]
    sequences: NDArray[np.int64]
    data: list[bytes]
    by_log_time: bool = False


class Recorded(Protocol):
    """A recording that is open for reading: an .mcap, or a bag of ROS 1 or 2."""

    @property
    def path(self) -> Path:
        """The file or the bag's folder, for error messages."""
        ...

    @property
    def topics(self) -> Mapping[str, Topic]:
        """What there is, by name."""
        ...

    @property
    def remarks(self) -> Sequence[str]:
        """What a user should know of how the recording was read; of what was read until now."""
        ...

    def messages(self, names: Collection[str]) -> dict[str, Messages]:
        """All messages of the topics named, as ROS 2 would serialise them; topics without messages are left out."""
        ...


@dataclass(frozen=True)
class Names:
    """Topics and frames to read, where the recording leaves a choice or says it wrongly; None: found by their types.

    ``scan_topic`` may be several, parted by commas: lasers of one robot that are taken together. ``odom_topic`` may be
    a topic of transforms. ``base_frame``: the robot's centre, whose place is sought, if that is not the frame that the
    odometry moves. ``odom_frame``: the parent of the transforms that are the odometry. ``laser_frame``: one of several
    lasers on a topic, or the frame that the scans should have named. What a recording lacks: ``laser_pose`` (m, m,
    rad), the laser on the robot, instead of what the transforms say; ``stamps``: "log" for when the messages were
    written down, where the clocks of those who stamped them disagree, else "header"; ``transforms``: static ones,
    which count before those of the recording.
    """

    scan_topic: str | None = None
    odom_topic: str | None = None
    base_frame: str | None = None
    odom_frame: str | None = None
    laser_frame: str | None = None
    laser_pose: Pose | None = None
    stamps: str | None = None
    transforms: tuple[GivenTransform, ...] = ()


@dataclass(frozen=True)
class ByLogTime:
    """A recording whose messages count from when they were written down."""

    recorded: Recorded

    @property
    def path(self) -> Path:
        """The file or the bag's folder, for error messages."""
        return self.recorded.path

    @property
    def topics(self) -> Mapping[str, Topic]:
        """What there is, by name."""
        return self.recorded.topics

    @property
    def remarks(self) -> Sequence[str]:
        """What a user should know of how the recording was read."""
        return self.recorded.remarks

    def messages(self, names: Collection[str]) -> dict[str, Messages]:
        """All messages of the topics named."""
        return {name: replace(said, by_log_time=True) for name, said in self.recorded.messages(names).items()}


def counted(topics: Mapping[str, Topic], found: Mapping[str, tuple[list[int], list[bytes]]]) -> dict[str, Messages]:
    """Log times and contents by topic, in the order of the file, as messages whose sequences count them.

    They are put in the order of their log times, unless these begin anew somewhere.
    """
    result = {}
    for name, (times, contents) in found.items():
        at, data = np.array(times, dtype=np.int64), contents
        if (np.diff(at) < 0).any() and numbered(at) is None:
            order = np.argsort(at, kind="stable")
            at, data = at[order], [contents[i] for i in order]
        result[name] = Messages(topics[name], at, np.arange(len(data)), data)
    return result


def check_complete(path: Path, topics: Mapping[str, Topic], names: Collection[str], found: Collection[str]) -> None:
    """Raises MclError if a topic that was asked for and should have messages has none."""
    for name in names:
        if name in topics and topics[name].count and name not in found:
            raise MclError(f"damaged: {topics[name].count} messages on {name} promised, none there", path=path)


def describe(topics: Mapping[str, Topic]) -> str:
    """What a file holds, for an error message: every topic with its type and number of messages."""
    listed = [f"{t.name} ({t.type or t.encoding}, {t.count})" for t in topics.values()]
    return "it has " + shortened(listed, "topics") if listed else "it has no messages at all"


def no_topic(name: str, topics: Mapping[str, Topic]) -> str:
    """What is said of a topic that is not there: which one it may have been, or all that there are."""
    return f"no topic {name} in this file: {did_you_mean(name, topics) or describe(topics)}"


def shortened(items: Iterable[str], what: str) -> str:
    """The first dozen of the items, and how many more there are."""
    listed = list(items)
    if len(listed) > _LISTED:
        listed = [*listed[:_LISTED], f"and {len(listed) - _LISTED} more {what}"]
    return ", ".join(listed)
