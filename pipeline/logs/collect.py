"""What a drive consists of, found in anybody's recording: scans, odometry, and the laser's place on the robot."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.logs import schema
from pipeline.logs.columns import GyroscopeColumns, PoseColumns, ScanColumns
from pipeline.logs.decode import decode_odometry, decode_scans
from pipeline.logs.gyroscope import collect_gyroscope
from pipeline.logs.recorded import Messages, Names, Recorded, Topic, describe
from pipeline.logs.transforms import Transforms, moved

_PREFERRED = (schema.SCAN, schema.ODOMETRY, schema.MAP, schema.IMU)
_NOT_MEANT = {schema.ODOMETRY_TYPE: "truth", schema.GRID_TYPE: "costmap"}
"""What a topic's name must not say to be chosen: a simulator's truth, the maps that a planner makes for itself."""
_STANDS_OUT = 10
"""So many times as often as readings just below it must the longest range occur to mean that nothing came back."""


@dataclass(frozen=True)
class Drive:
    """Scans and odometry as recorded, ``laser_in_base`` (4, 4), and the topics and frames that they are from.

    ``odometry`` and ``gyroscope`` are None where the recording has none.
    """

    scans: ScanColumns
    odometry: PoseColumns | None
    laser_in_base: NDArray[np.float64]
    origin: dict[str, str]
    gyroscope: GyroscopeColumns | None = None


def collect(recorded: Recorded, names: Names | None = None) -> Drive:
    """Scans, odometry and the laser's place: where ``names`` does not say it, by their types and by the transforms.

    Odometry is a topic of Odometry messages, else odom -> base among the transforms. Without either, and unless
    ``names`` asks for it, there is none: then the robot's centre is the root of the transforms that carry the laser, or
    the laser itself in a recording without transforms. A gyroscope is a topic of Imu messages. Raises MclError if the
    scans, odometry that was asked for, or the laser's place are missing, and says what the recording has instead.
    """
    names = names or Names()
    try:
        return _collect(recorded, names)
    except MclError as error:
        raise error if error.path else MclError(error.message, error.hint, path=recorded.path) from error


def find(recorded: Recorded, kind: str) -> str | None:
    """The topic of that type that the contract names, else the one with the most messages."""
    usable = [t for t in recorded.topics.values() if t.type == kind and _readable(t)]
    usable = [t for t in usable if t.name != schema.LASER_ODOMETRY]  # ours, made from the scans: no second witness
    meant = [t for t in usable if _NOT_MEANT.get(kind, "\n") not in t.name.lower()]
    best = max(meant, key=lambda t: (t.name in _PREFERRED, t.count, t.name), default=None)
    return None if best is None else best.name


def mark_no_return(scans: ScanColumns) -> ScanColumns:
    """The scans with a longest range that is a number and above which nothing came back.

    Simulators and older drivers say "nothing" by a reading of exactly the longest range, where REP 117 has infinity:
    if that stands out among the readings just below it, the longest range becomes the next smaller number. If a
    driver never filled in the longest range, it is the longest reading.
    """
    finite = scans.ranges[np.isfinite(scans.ranges)]
    longest = np.float32(scans.range_max)
    if not (np.isfinite(longest) and longest > max(scans.range_min, 0.0)):
        longest = finite.max(initial=np.float32(0.0))
        return replace(scans, range_max=float(longest)) if longest > 0 else scans
    at_the_end = int(np.count_nonzero(finite == longest))
    below = int(np.count_nonzero((finite < longest) & (finite >= longest * np.float32(0.99))))
    if at_the_end > _STANDS_OUT * max(below, len(scans) / 100):
        return replace(scans, range_max=float(np.nextafter(longest, np.float32(0.0))))
    return scans


def _collect(recorded: Recorded, names: Names) -> Drive:
    scan_topic = _chosen(recorded, names.scan_topic, (schema.LASER_SCAN_TYPE,)) or find(
        recorded, schema.LASER_SCAN_TYPE
    )
    if scan_topic is None:
        raise MclError(f"no laser scans ({schema.LASER_SCAN_TYPE}) in this file: {describe(recorded.topics)}")
    odom_topic = _chosen(recorded, names.odom_topic, (schema.ODOMETRY_TYPE, schema.TF_TYPE))
    odom_topic = odom_topic or find(recorded, schema.ODOMETRY_TYPE)
    messages = recorded.messages({scan_topic} if odom_topic is None else {scan_topic, odom_topic})
    scans = decode_scans(messages[scan_topic], names.laser_frame)
    laser = (names.laser_frame or scans.frame).lstrip("/")
    transforms = Transforms(recorded)
    found = _odometry(odom_topic, messages, transforms, names, laser)
    if found is None:
        odometry, odom, base = None, schema.ODOM_FRAME, names.base_frame or transforms.root(laser)
        if base == laser and not names.base_frame and transforms and not transforms.knows(laser):
            raise _unplaced("the robot", laser, transforms)
        laser_in_base = transforms.place(laser, base, odom)
    else:
        odometry, odom, base = found
        laser_in_base = transforms.place(laser, base, odom)
    if laser_in_base is None:
        raise _unplaced(repr(base), laser, transforms)
    gyroscope, about_gyroscope = collect_gyroscope(recorded, find(recorded, schema.IMU_TYPE), transforms, base, odom)
    origin = {
        "scan_topic": scan_topic,
        "odometry_topic": "" if odometry is None else odom_topic or schema.TF,
        "frames": f"{odom} -> {base} -> {laser}",
        "scans_resampled": str(scans.resampled),
        **about_gyroscope,
    }
    if odometry is None and not transforms:
        origin["laser_at_centre"] = "no transform says where it is"
    return Drive(scans, odometry, laser_in_base, origin, gyroscope)


def _odometry(
    topic: str | None, messages: Mapping[str, Messages], transforms: Transforms, names: Names, laser: str
) -> tuple[PoseColumns, str, str] | None:
    """The odometry of the robot's centre, its frame, and the frame of the centre; None if nobody recorded any."""
    if topic is None or messages[topic].topic.type == schema.TF_TYPE:
        asked = topic is not None or names.odom_frame is not None
        if not asked and not transforms.tells_odometry(names.base_frame or laser):
            return None
        odometry = transforms.odometry(names.base_frame or laser, names.odom_frame)
    else:
        odometry = decode_odometry(messages[topic])
        frames = odometry.frame.lstrip("/"), odometry.child_frame.lstrip("/")  # as ROS 1 wrote them
        odometry = replace(odometry, frame=frames[0], child_frame=frames[1])
    odom = names.odom_frame or odometry.frame
    child = odometry.child_frame or transforms.base_below(odom, laser) or names.base_frame
    if not child:
        raise MclError(f"{topic} does not say which frame it moves; {transforms.describe()}", "--base-frame says it")
    base = names.base_frame or child
    if base != child:
        place = transforms.place(base, child, odom)
        # What nothing connects to the frame that the odometry names is that frame by its right name.
        odometry = replace(odometry, child_frame=base) if place is None else moved(odometry, base, place)
    return odometry, odom, base


def _unplaced(base: str, laser: str, transforms: Transforms) -> MclError:
    return MclError(
        f"no transform from {base} to the laser {laser!r}: {transforms.describe()}",
        "--base-frame and --laser-frame choose others; the same for both: the laser is at the robot's centre",
    )


def _chosen(recorded: Recorded, name: str | None, kinds: Collection[str]) -> str | None:
    """The topic that the user named, if it can be what it should be."""
    if name is None:
        return None
    topic = recorded.topics.get(name)
    if topic is None:
        raise MclError(f"no topic {name} in this file: {describe(recorded.topics)}")
    if topic.type not in kinds or not _readable(topic):
        raise MclError(
            f"{name} has {topic.count} messages of {topic.type or 'no type'} ({topic.encoding}), not of "
            f"{' or '.join(kinds)}: {describe(recorded.topics)}"
        )
    return name


def _readable(topic: Topic) -> bool:
    return topic.encoding == schema.MESSAGE_ENCODING and topic.count > 0
