"""What a gyroscope says of the robot's heading: turn rates out of Imu messages, and headings at the scans' stamps.

Nothing looks ahead: the heading at a stamp follows from what had been measured by then. Orientations that an IMU works
out by itself are left aside, for how they come about, with a compass or without, no message says.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.logs.columns import GyroscopeColumns, PoseColumns
from pipeline.logs.decode import decode_rates
from pipeline.logs.recorded import Recorded
from pipeline.logs.stretches import numbered
from pipeline.logs.transforms import Transforms

GAP = 500_000_000
"""ns without a message after which nobody knows how far the robot has turned meanwhile."""
FASTEST = 35.0
"""rad/s: gyroscopes measure up to 2000 degrees per second, and what is above is no measurement."""
STILL_FOR = 500_000_000
"""ns for which the odometry must not have moved for the gyroscope's zero to be learned."""
STILL_WITHIN = 0.002
"""m, rad by which the odometry of a robot that stands still may differ in that time."""
LARGEST_BIAS = 0.05
"""rad/s: a rate above is a turn, whatever the odometry says."""


def collect_gyroscope(
    recorded: Recorded, topic: str | None, transforms: Transforms, base: str, odom: str
) -> tuple[GyroscopeColumns | None, dict[str, str]]:
    """The turn rates about the vertical axis of ``base``, and what is to be told of them; None without a topic.

    The sensor may be mounted in any way that the transforms tell; in a recording without transforms it lies flat.
    Rates that are no numbers, or that no gyroscope measures, are left out and counted; the rest stays in the order of
    the file. What cannot be used, for the transforms do not reach it, say, leaves the recording as it would be without.
    """
    if topic is None:
        return None, {}
    about = {"imu_topic": topic}
    try:
        stamps, rates, frame = decode_rates(recorded.messages([topic])[topic])
        frame = frame or base
        place = transforms.place(frame, base, odom) if transforms else np.eye(4)
    except MclError as error:
        return None, about | {"imu_unused": error.message}
    if place is None:
        return None, about | {"imu_unused": f"no transform from {base!r} to {frame!r}"}
    up = place[2, :3]
    with np.errstate(invalid="ignore"):
        sound = (np.abs(rates) < FASTEST).all(axis=1)
    if not sound.all():
        about["imu_left_out"] = str(int((~sound).sum()))
    if not rates[sound].any():
        return None, about | {"imu_unused": "its rates were never filled in"}
    columns = GyroscopeColumns(stamps[sound], rates[sound] @ up, base)
    stretch = numbered(columns.stamps)
    if stretch is not None:
        about["imu_left_out"] = str(int(about.get("imu_left_out", "0")) + int((stretch < 0).sum()))
        columns = replace(columns.take(stretch >= 0), stretch=stretch[stretch >= 0])
    return columns, about


def turns_at(
    stamps: NDArray[np.int64], gyroscope: GyroscopeColumns, odometry: PoseColumns | None = None
) -> NDArray[np.float64] | None:
    """Headings (n,) rad, from any zero and without end, at the scans' ``stamps`` (n,), in order, ns.

    Rates are integrated by trapezoids up to the last message before a stamp, and held from there on. Where the
    ``odometry`` stood still and the rates were small, their mean up to then is the zero that later ones are counted
    from. Scans within a gap of more than ``GAP`` are NaN, and if no scan is, the first one after it: between two scans
    in a row whose headings are numbers, the turn was measured. None if fewer than two scans have a heading.
    """
    times, first = np.unique(gyroscope.stamps, return_index=True)
    rates = gyroscope.rates[first]
    rates = rates - _bias(times, rates, odometry)
    steps = np.diff(times)
    known = np.where(steps <= GAP, 0.5 * (rates[1:] + rates[:-1]) * steps / 1e9, 0.0)
    headings = np.concatenate([[0.0], np.cumsum(known)])
    stretches = np.concatenate([[0], np.cumsum(steps > GAP)])
    last = np.searchsorted(times, stamps, "right") - 1
    at = np.maximum(last, 0)
    since = stamps - times[at]
    covered = (last >= 0) & (since <= GAP)
    turns = np.where(covered, headings[at] + rates[at] * since / 1e9, np.nan)
    begins_anew = covered[1:] & covered[:-1] & (np.diff(stretches[at]) > 0)
    turns[1:][begins_anew] = np.nan
    return turns if np.count_nonzero(np.isfinite(turns)) > 1 else None


def _bias(times: NDArray[np.int64], rates: NDArray[np.float64], odometry: PoseColumns | None) -> NDArray[np.float64]:
    """The rate (n,) that stands for no turn, as known at each of the times (n,): 0 until the robot has stood still."""
    if odometry is None or len(odometry) < 2:
        return np.zeros(len(times))
    order = np.argsort(odometry.stamps, kind="stable")
    stamps, poses = odometry.stamps[order], odometry.planar[order]
    now = np.searchsorted(stamps, times, "right") - 1
    before = np.searchsorted(stamps, times - STILL_FOR, "right") - 1
    recent = (before >= 0) & (now > before)
    recent[recent] = times[recent] - stamps[now[recent]] <= STILL_FOR
    moved = poses[now] - poses[before]
    moved[:, 2] = np.sin(0.5 * moved[:, 2]) * 2.0
    with np.errstate(invalid="ignore"):
        still = recent & (np.abs(moved).max(axis=1) <= STILL_WITHIN) & (np.abs(rates) <= LARGEST_BIAS)
    counts = np.cumsum(still)
    return np.where(counts > 0, np.cumsum(np.where(still, rates, 0.0)) / np.maximum(counts, 1), 0.0)
