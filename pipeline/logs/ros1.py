"""Messages as ROS 1 serialised them, into those of ROS 2: by the definitions of ROS 1's own packages, or the file's."""

from __future__ import annotations

from functools import cache
from typing import Any, Final

from pipeline.logs import schema

ENCODING: Final = "ros1"
_RENAMED = {"tf/msg/tfMessage": schema.TF_TYPE}
"""Types that ROS 2 has under another name, with the same content."""


def type_in_ros2(kind: str) -> str:
    """The type's name in ROS 2: of ``sensor_msgs/LaserScan`` it is sensor_msgs/msg/LaserScan."""
    package, _, name = kind.partition("/")
    full = kind if "/msg/" in kind or not name else f"{package}/msg/{name}"
    return _RENAMED.get(full, full)


def as_ros2(data: bytes, kind: str, definition: str) -> bytes:
    """A message of type ``kind`` as ROS 2 serialises it; ``definition``: its own text, for types of nobody else's.

    Raises whatever rosbags stumbles over in a message that is none.
    """
    ros1, ros2 = _stores()
    package, _, name = kind.partition("/")
    full = kind if "/msg/" in kind else f"{package}/msg/{name}"
    if full not in ros1.fielddefs:
        from rosbags.typesys import get_types_from_msg

        types = get_types_from_msg(definition, full)
        ros1.register({name: fields for name, fields in types.items() if name not in ros1.fielddefs})
    return bytes(ros2.serialize_cdr(ros1.deserialize_ros1(data, full), type_in_ros2(kind)))


@cache
def _stores() -> tuple[Any, Any]:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)
