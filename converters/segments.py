"""Stretches of a log between which the robot was carried: how each was shifted in time and moved in the odometry frame.

Where lines are left out, or a second log is joined on, the odometry of what follows is moved rigidly so that it
goes on from the last pose before: the wheels did not turn while the robot was carried. The motion
is kept, so that the source's own numbers can be given back.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.geometry import Pose


@dataclass(frozen=True)
class Segment:
    """Messages from ``first_sequence`` on, until the next segment begins.

    They are from file number ``source``; there the line number was ``sequence - sequence_offset``, the stamp
    ``stamp - stamp_shift`` (ns), and the pose ``inverse(motion) (+) pose`` (m, m, rad).
    """

    source: int
    first_sequence: int
    sequence_offset: int
    stamp_shift: int
    motion: Pose


def move_back(poses: NDArray[np.float64], motion: Pose) -> NDArray[np.float64]:
    """The poses before ``move``."""
    if motion == (0.0, 0.0, 0.0):
        return poses
    x, y, yaw = motion
    cos, sin = np.cos(yaw), np.sin(yaw)
    dx, dy = poses[:, 0] - x, poses[:, 1] - y
    return np.column_stack([cos * dx + sin * dy, -sin * dx + cos * dy, poses[:, 2] - yaw])


def to_metadata(segments: Sequence[Segment]) -> dict[str, str]:
    """The segments as a metadata record."""
    return {str(i): json.dumps(asdict(segment)) for i, segment in enumerate(segments)}


def from_metadata(record: Mapping[str, str]) -> list[Segment]:
    """The segments from the metadata record that ``to_metadata`` made."""
    result = []
    for _, text in sorted(record.items(), key=lambda item: int(item[0])):
        values = json.loads(text)
        x, y, yaw = values.pop("motion")
        result.append(Segment(**values, motion=(x, y, yaw)))
    return result
