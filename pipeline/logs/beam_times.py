"""When each beam of a scan was measured, and how the odometry moved meanwhile."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.geometry import between
from pipeline.logs.columns import PoseColumns
from pipeline.logs.leaps import leapt
from pipeline.logs.messages import Laser
from pipeline.logs.odometry import odometry_at

LONGEST = 1.5
"""Intervals between scans that one of them may take: what is longer says that the field was filled in wrongly."""
ROUNDING = 1e-9
"""m, rad: who moved less stood still."""


def checked(laser: Laser, stamps: NDArray[np.int64]) -> tuple[Laser, str]:
    """The laser with a time from beam to beam that can be one, else 0, and then what was wrong with it.

    ``stamps`` (n,) ns in order. No scan takes longer than ``LONGEST`` times the usual interval to the next one.
    """
    if laser.time_increment == 0.0:
        return laser, ""
    whole = laser.beams * abs(laser.time_increment)
    intervals = np.diff(stamps)
    intervals = intervals[intervals > 0]
    usual = float(np.median(intervals)) / 1e9 if len(intervals) else np.inf
    if whole <= LONGEST * usual and np.isfinite(whole):
        return laser, ""
    wrong = f"{laser.beams} beams {abs(laser.time_increment):g} s apart do not fit into {usual:.3g} s from scan to scan"
    return replace(laser, time_increment=0.0), wrong if np.isfinite(
        whole
    ) else "the time from beam to beam is no number"


def sweeps_of(
    laser: Laser, stamps: NDArray[np.int64], poses: NDArray[np.float64], odometry: PoseColumns
) -> NDArray[np.float64] | None:
    """How the odometry moved (n, 3) m, m, rad in the robot's frame from each scan's first-measured beam to its last.

    ``stamps`` (n,) ns, of the first-measured beams, and ``poses`` (n, 3) the odometry there. Where the odometry ends
    before the scan does, as far as it goes. Motions that no robot makes count as none. None if all beams of a scan are
    of its stamp.
    """
    if laser.time_increment == 0.0:
        return None
    lasts = round((laser.beams - 1) * abs(laser.time_increment) * 1e9)
    ends = np.minimum(stamps + lasts, odometry.stamps.max())
    there, _ = odometry_at(ends, np.full(len(ends), -1), odometry)
    sweeps = between(poses, there)
    sweeps[np.abs(sweeps).max(axis=1) < ROUNDING] = 0.0
    sweeps[leapt(sweeps, lasts / 1e9) | ~np.isfinite(sweeps).all(axis=1)] = 0.0
    return sweeps
