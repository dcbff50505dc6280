"""Which topics of a recording are the robot's: by their types, and by the namespace where there are several robots."""

from __future__ import annotations

from collections.abc import Collection

from pipeline.errors import MclError
from pipeline.logs import schema
from pipeline.logs.recorded import Recorded, Topic, describe, no_topic

SCAN_TYPES = (schema.LASER_SCAN_TYPE, schema.MULTI_ECHO_TYPE)
_PREFERRED = (schema.SCAN, schema.ODOMETRY, schema.MAP, schema.IMU)
_NOT_MEANT = {schema.ODOMETRY_TYPE: "truth", schema.GRID_TYPE: "costmap"}
"""What a topic's name must not say to be chosen: a simulator's truth, the maps that a planner makes for itself."""


def candidates(recorded: Recorded, *kinds: str, beside: str | None = None) -> list[str]:
    """The topics of these types that may be meant, the best first.

    That is those of the same robot as the topic ``beside``, if one is given, nearest by namespace; then the one that
    the contract names; then the one with the most messages. Types count in their order.
    """
    usable = [t for t in recorded.topics.values() if t.type in kinds and readable(t)]
    usable = [t for t in usable if t.name != schema.LASER_ODOMETRY]  # ours, made from the scans: no second witness
    usable = [t for t in usable if _NOT_MEANT.get(t.type, "\n") not in t.name.lower()]
    if beside is not None:
        mine = of_robot(recorded, beside, [t.name for t in usable])
        usable = [t for t in usable if t.name in mine]

    def rank(t: Topic) -> tuple[int, bool, int, int, str]:
        near = 0 if beside is None else _common(t.name, beside)
        return near, t.name in _PREFERRED, -kinds.index(t.type), t.count, t.name

    return [t.name for t in sorted(usable, key=rank, reverse=True)]


def find(recorded: Recorded, kind: str, beside: str | None = None) -> str | None:
    """The best of the candidates, None if there are none."""
    return next(iter(candidates(recorded, kind, beside=beside)), None)


def of_robot(recorded: Recorded, scan_topic: str, topics: Collection[str]) -> dict[str, int]:
    """Those of the topics that are not nearer, by their namespace, to the scans of another robot; how near each is.

    If some are of the robot's own namespace, they and those of no namespace.
    """
    others = [t.name for t in recorded.topics.values() if t.type in SCAN_TYPES and readable(t) and t.name != scan_topic]
    near = {name: _common(name, scan_topic) for name in topics}
    own = {name: near[name] for name in topics if all(_common(name, other) <= near[name] for other in others)}
    if any(own.values()):
        return {name: how for name, how in own.items() if how or not _namespace(name)}
    return own


def chosen(recorded: Recorded, name: str | None, kinds: Collection[str]) -> str | None:
    """The topic that the user named, if it can be what it should be."""
    if name is None:
        return None
    topic = recorded.topics.get(name)
    if topic is None:
        raise MclError(no_topic(name, recorded.topics))
    if topic.type not in kinds or not readable(topic):
        raise MclError(
            f"{name} has {topic.count} messages of {topic.type or 'no type'} ({topic.encoding}), not of "
            f"{' or '.join(kinds)}: {describe(recorded.topics)}"
        )
    return name


def readable(topic: Topic) -> bool:
    """Whether a topic has messages, in the encoding of ROS 2."""
    return topic.encoding == schema.MESSAGE_ENCODING and topic.count > 0


def _namespace(topic: str) -> list[str]:
    return [part for part in topic.split("/") if part][:-1]


def _common(a: str, b: str) -> int:
    """How many names the namespaces of two topics begin with alike."""
    count = 0
    for x, y in zip(_namespace(a), _namespace(b), strict=False):
        if x != y:
            break
        count += 1
    return count
