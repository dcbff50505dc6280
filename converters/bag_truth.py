"""Where a bag itself says that the robot was: poses that a localization, a simulator or a tracker published."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.geometry import compose
from pipeline.logs import schema
from pipeline.logs.choice import of_robot
from pipeline.logs.collect import Drive
from pipeline.logs.columns import PoseColumns
from pipeline.logs.decode import decode_odometry, decode_poses, decode_stamped_poses
from pipeline.logs.messages import Trajectory
from pipeline.logs.recorded import Recorded
from pipeline.logs.transforms import Transforms

AMCL_TYPE = "geometry_msgs/msg/PoseWithCovarianceStamped"


def read_truth(recorded: Recorded, topic: str, drive: Drive) -> Trajectory:
    """The robot's centre in the map, as a topic of poses says it, or the transforms from the map down.

    The transforms say it at the stamps of the odometry, with the last map -> odom before; without odometry, map -> base
    at its own. Raises MclError for a topic
    that has neither.
    """
    kind = recorded.topics[topic].type
    if kind == schema.TF_TYPE:
        return _from_transforms(recorded, drive)
    read: dict[str, Any] = {
        schema.POSE_TYPE: decode_poses,
        schema.ODOMETRY_TYPE: decode_odometry,
        AMCL_TYPE: decode_stamped_poses,
    }
    if kind not in read or not recorded.topics[topic].count:
        raise MclError(
            f"{topic} ({kind}, {recorded.topics[topic].count}) says no poses",
            f"expected messages of {', '.join(read)}, or {schema.TF}",
            path=recorded.path,
        )
    poses: PoseColumns = drive.clock(read[kind](recorded.messages([topic])[topic]))
    return _trajectory(poses.stamps, poses.planar, poses.frame)


def _from_transforms(recorded: Recorded, drive: Drive) -> Trajectory:
    said = [t.name for t in recorded.topics.values() if t.type == schema.TF_TYPE]
    transforms = Transforms(recorded, of_robot(recorded, drive.origin["scan_topic"], said))
    odom, base, _ = drive.origin["frames"].split(" -> ")
    if drive.odometry is None:  # then what is above the robot's centre is the map
        odom = base
    links = {**transforms.moving, **transforms.static}
    if odom not in links:
        raise MclError(f"no transform from a map to {odom!r}: {transforms.describe()}", path=recorded.path)
    link = drive.clock(links[odom])
    order = np.argsort(link.stamps, kind="stable")
    stamps, places = link.stamps[order], link.planar[order]
    if drive.odometry is None:
        return _trajectory(stamps, places, link.frame)
    last = np.searchsorted(stamps, drive.odometry.stamps, "right") - 1
    known = last >= 0
    poses = compose(places[last[known]], drive.odometry.planar[known])
    return _trajectory(drive.odometry.stamps[known], poses, link.frame)


def _trajectory(stamps: NDArray[np.int64], poses: NDArray[np.float64], frame: str) -> Trajectory:
    """In the order of the stamps, each once."""
    times, first = np.unique(stamps, return_index=True)
    return Trajectory(times, poses[first], frame.lstrip("/"))
