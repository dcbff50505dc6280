"""Which of a recording's odometries tells how the robot drove: each is tried before it is taken."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.errors import MclError
from pipeline.logs import schema
from pipeline.logs.columns import PoseColumns, ScanColumns
from pipeline.logs.decode import decode_odometry
from pipeline.logs.recorded import Messages, Names, Recorded
from pipeline.logs.transforms import Transforms, moved

STILL = 1e-3
"""m, rad: odometry that never moves farther than this is dead, or the robot stood still all the time."""
MANY = 10
"""So few messages say nothing of whether odometry is dead."""
CHANGED, BEAMS, LOOKED_AT = 0.3, 0.5, 50
"""m by which so large a share of the beams must differ from the first scan's, in one of so many scans, for the robot
not to have stood still: people in front of it change fewer."""


@dataclass(frozen=True)
class FoundOdometry:
    """The odometry of the robot's centre (None if nobody recorded any), its frame, that of the centre ("" if nobody
    says it), its topic, and remarks on it and on what was not taken."""

    odometry: PoseColumns | None
    odom: str
    base: str
    topic: str
    remarks: tuple[str, ...] = ()


def find_odometry(
    recorded: Recorded,
    topics: Sequence[str],
    messages: Mapping[str, Messages],
    transforms: Transforms,
    names: Names,
    scans: ScanColumns,
    laser: str,
    mend: bool,
) -> FoundOdometry:
    """The first of ``topics`` (Odometry, or transforms) that fits, else odom -> base among the transforms.

    With ``mend``, and where ``names`` does not ask for one, odometry that never moves though the scans change gives way
    to another, or to none. ``messages`` holds those of the first topic. Raises MclError if odometry that was asked for
    is not there.
    """
    found = _read(topics[0] if topics else None, messages, transforms, names, laser)
    asked = names.odom_topic is not None or names.odom_frame is not None
    if found.odometry is None or asked or not mend or not (wrong := _dead(found.odometry)):
        return found
    for topic in (*topics[1:], schema.TF):
        if topic == schema.TF and not (topics and transforms.tells_odometry(names.base_frame or laser)):
            continue
        try:
            said = {} if topic == schema.TF else recorded.messages({topic})
            other = _read(None if topic == schema.TF else topic, said, transforms, names, laser)
        except MclError:
            continue
        if other.odometry is not None and not _dead(other.odometry):
            return replace(other, remarks=(*other.remarks, f"{found.topic} {wrong}: {other.topic} is taken instead"))
    if not _changing(scans):
        return found
    remark = f"{found.topic} {wrong}, though the scans change: it is not used, and the laser alone tells the motion"
    return replace(found, odometry=None, remarks=(*found.remarks, f"{remark}; --odom-topic takes it all the same"))


def _read(
    topic: str | None, messages: Mapping[str, Messages], transforms: Transforms, names: Names, laser: str
) -> FoundOdometry:
    """The odometry by a topic, or by the transforms."""
    if topic is None or messages[topic].topic.type == schema.TF_TYPE:
        asked = topic is not None or names.odom_frame is not None
        if not asked and not transforms.tells_odometry(names.base_frame or laser):
            return FoundOdometry(None, schema.ODOM_FRAME, "", "")
        odometry = transforms.odometry(names.base_frame or laser, names.odom_frame)
    else:
        odometry = decode_odometry(messages[topic])
        frames = odometry.frame.lstrip("/"), odometry.child_frame.lstrip("/")  # as ROS 1 wrote them
        odometry = replace(odometry, frame=frames[0], child_frame=frames[1])
    odom = names.odom_frame or odometry.frame
    child = odometry.child_frame or transforms.base_below(odom, laser) or names.base_frame
    if not child and names.laser_pose is not None:
        child = schema.BASE_FRAME
    if not child:
        raise MclError(f"{topic} does not say which frame it moves; {transforms.describe()}", "--base-frame says it")
    base = names.base_frame or child
    if base != child:
        place = transforms.place(base, child, odom)
        # What nothing connects to the frame that the odometry names is that frame by its right name.
        odometry = replace(odometry, child_frame=base) if place is None else moved(odometry, base, place)
    return FoundOdometry(odometry, odom, base, topic or schema.TF, odometry.remarks)


def _dead(odometry: PoseColumns) -> str:
    """What is wrong with odometry that says nothing; empty if it says something."""
    if len(odometry) < MANY:
        return ""
    planar = odometry.planar
    return "never moves" if np.abs(planar - planar[0]).max() < STILL else ""


def _changing(scans: ScanColumns) -> bool:
    """Whether the robot cannot have stood still all the time, by its scans."""
    rows = scans.ranges[np.unique(np.linspace(0, len(scans) - 1, LOOKED_AT).astype(int))]
    with np.errstate(invalid="ignore"):
        both = np.isfinite(rows) & np.isfinite(rows[0])
        apart = both & (np.abs(rows - rows[0]) > CHANGED)
    return bool((apart.sum(axis=1) > BEAMS * np.maximum(both.sum(axis=1), 1)).any())
