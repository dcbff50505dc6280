"""The truth at the stamps of the scans."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.logs.messages import Log
from pipeline.motion.faults import without_leaps

JUMP = 0.5  # metres beyond what the odometry moved: the path is not drawn across
FASTEST = 3.0  # m/s that a robot without odometry may drive

Truth = tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_]]


def truth_at_scans(log: Log) -> Truth | None:
    """Which scans (n,) it is known at, the poses (n, 3) there, and whether each goes on from the one before, (n,)."""
    truth, stamps = log.ground_truth, log.stamps
    if truth is None or len(truth.stamps) == 0:
        return None
    inside = np.flatnonzero((stamps >= truth.stamps[0]) & (stamps <= truth.stamps[-1]))
    if len(inside) == 0:
        return None
    # Seconds since the first scan: epoch nanoseconds do not fit a float.
    known, wanted = ((s - stamps[0]) / 1e9 for s in (truth.stamps, stamps[inside]))
    x, y, yaw = (np.interp(wanted, known, c) for c in (*truth.poses[:, :2].T, np.unwrap(truth.poses[:, 2])))
    poses = np.stack([x, y, yaw], axis=-1)
    # Where somebody carried the robot, the truth leaps and the odometry does not.
    travelled = np.hypot(*np.diff(without_leaps(log.times, log.odometry)[inside, :2], axis=0, prepend=np.nan).T)
    if not log.wheels:
        travelled = FASTEST * np.diff(wanted, prepend=np.nan)
    leapt = np.hypot(*np.diff(poses[:, :2], axis=0, prepend=np.nan).T)
    return inside, poses, leapt <= travelled + JUMP
