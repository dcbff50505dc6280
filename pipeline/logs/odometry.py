"""Odometry at the stamps of scans."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.geometry import wrap_angle
from pipeline.logs.columns import PoseColumns


def odometry_at(
    stamps: NDArray[np.int64], sequences: NDArray[np.int64], odometry: PoseColumns
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Poses (n, 3) at the scans' stamps, and which of the scans lie within the odometry's span."""
    order = np.argsort(odometry.stamps, kind="stable")
    times, poses, numbers = odometry.stamps[order], odometry.planar[order], odometry.sequences[order]
    left, right = np.searchsorted(times, stamps, "left"), np.searchsorted(times, stamps, "right")
    inside = (stamps >= times[0]) & (stamps <= times[-1])
    before, after = np.clip(right - 1, 0, None), np.clip(right, None, len(times) - 1)
    exact = right > left
    share = (stamps - times[before]) / np.maximum(times[after] - times[before], 1)
    share[exact] = 0.0
    for i in np.flatnonzero(right - left > 1):
        same = np.flatnonzero(numbers[left[i] : right[i]] == sequences[i])
        if len(same):
            before[i] = left[i] + same[0]
    step = poses[after] - poses[before]
    step[:, 2] = wrap_angle(step[:, 2])
    result = poses[before] + share[:, None] * step
    result[~exact, 2] = wrap_angle(result[~exact, 2])
    return result, inside
