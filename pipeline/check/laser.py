"""Whether the laser can be what the log says: its field of view, its beams, its readings."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from pipeline.check.findings import NOTHING, Finding
from pipeline.config import Config
from pipeline.logs.messages import Log

LOOKED_AT = 500
"""Scans that are looked at, spread over the log."""
FULL_TURN = 2.0 * math.pi * 1.02
"""rad: a field of view above that has its increment, or its number of beams, wrong."""
DEAD, MANY_DEAD = 0.05, 0.5
"""Share of the beams that never measure anything, from which on it is told, and doubted."""
INVALID = 0.5
"""Share of all readings that are no ranges, from which on the laser is doubted."""
OWN_D, OWN_SPREAD, OWN = 0.6, 0.01, 0.03
"""m, m, share of the beams: beams that always end so near, within so little, see the robot itself."""
DROVE = 2.0
"""m: who has not driven so far sees the same all the time anyway."""
HANGS = 0.05
"""Share of the scans that repeat the one before to the last digit though the wheels turned."""
MOVED = 0.02
"""m, rad: a step in which no two scans are alike."""


def findings_of_laser(log: Log) -> Iterator[Finding]:
    """What the ranges of the log themselves tell."""
    laser = log.laser
    width = laser.angle_increment * (laser.beams - 1)
    if width > FULL_TURN:
        yield Finding(
            "broken", "laser",
            f"{laser.beams} beams that are {math.degrees(laser.angle_increment):.3g} deg apart make "
            f"{math.degrees(width):.0f} deg, more than a full turn.",
            "The driver says a wrong angle_increment: it is the field of view divided by the number of beams less one.",
        )  # fmt: skip
    rows = log.ranges[np.unique(np.linspace(0, len(log) - 1, LOOKED_AT).astype(int))]
    there, beyond = np.isfinite(rows), np.isinf(rows)
    if not there.any():
        yield Finding(
            "broken", "laser", "No beam of any scan measured a range.",
            "Look at range_min and range_max of the scans, and at --set laser_min_range.",
        )  # fmt: skip
        return
    dead = float(np.mean(~there.any(axis=0)))
    invalid = float(np.mean(~there & ~beyond))
    if dead > DEAD:
        yield Finding(
            "doubtful" if dead > MANY_DEAD else "noted", "laser",
            f"{100 * dead:.0f} % of the beams never measured anything.",
            "Is something in front of the laser? If the driver masks them, nothing is to be done.",
        )  # fmt: skip
    if invalid > INVALID:
        yield Finding(
            "doubtful", "laser", f"{100 * invalid:.0f} % of all readings are no ranges (NaN, 0, or too short).",
            "Look at range_min, at the laser's window, and at --set laser_min_range.",
        )  # fmt: skip
    yield from _robot_itself(log, rows)
    yield from _hanging(log)
    if resampled := int(log.told.get("scans_resampled", "0")):
        many = resampled > 0.1 * len(log)
        yield Finding(
            "doubtful" if many else "noted", "laser",
            f"{resampled:,} of {len(log):,} scans have other beams than most; they are brought onto the same angles.",
            "Let the driver keep one setting while it records." if many else NOTHING,
        )  # fmt: skip
    if laser.time_increment:
        seconds = abs(laser.time_increment) * (laser.beams - 1)
        text = f"The beams of a scan are measured one after the other, in {seconds:.2f} s."
        yield Finding("noted", "laser", text, "Nothing: they are put right by how the robot moved meanwhile.")
    if wrong := log.told.get("beam_times_unused"):
        yield Finding("doubtful", "laser", f"The times of the beams are not used: {wrong}.", "Correct time_increment.")


def findings_of_message(message: Any) -> Iterator[Finding]:
    """Whether the angles of a LaserScan agree with the number of its ranges."""
    beams, step = len(message.ranges), float(message.angle_increment)
    first, last = float(message.angle_min), float(message.angle_max)
    if beams < 2 or step == 0.0 or not all(map(math.isfinite, (first, last, step))):
        return
    counted = (last - first) / step + 1.0
    off = abs(counted - beams)
    if off <= max(2.0, 0.01 * beams):
        return
    yield Finding(
        "broken" if off > 0.1 * beams else "doubtful", "laser",
        f"The angles contradict the number of ranges: from {math.degrees(first):.1f} to {math.degrees(last):.1f} deg "
        f"in steps of {math.degrees(step):.3g} deg would be {counted:,.0f} ranges, and the scans have {beams:,}.",
        "Mend the driver: angle_increment is (angle_max - angle_min) / (number of ranges - 1). The increment is "
        "believed.",
    )  # fmt: skip


def findings_of_limits(log: Log, config: Config) -> Iterator[Finding]:
    """Whether the parameters' shortest and longest range fit those that were measured."""
    ranges = log.ranges[np.unique(np.linspace(0, len(log) - 1, LOOKED_AT).astype(int))]
    measured = ranges[np.isfinite(ranges)]
    if not len(measured):
        return
    longest = log.laser.longest(config.laser_max_range)
    if config.laser_min_range >= longest:
        yield Finding(
            "broken", "parameters",
            f"laser_min_range is {config.laser_min_range:g} m, and the longest range that counts {longest:g} m.",
            "Set laser_min_range below laser_max_range.",
        )  # fmt: skip
        return
    near = float(np.mean(measured <= config.laser_min_range))
    if config.laser_min_range > 0.0 and near > 0.2:
        yield Finding(
            "doubtful", "parameters",
            f"laser_min_range = {config.laser_min_range:g} m leaves out {100 * near:.0f} % of the readings.",
            "Lower it.",
        )  # fmt: skip
    far = float(np.mean(measured > longest))
    if config.laser_max_range is not None and far > 0.2:
        yield Finding(
            "doubtful", "parameters",
            f"laser_max_range = {config.laser_max_range:g} m cuts {100 * far:.0f} % of the readings.",
            f"Raise it: this laser measured up to {np.percentile(measured, 99):.1f} m.",
        )  # fmt: skip
    elif config.laser_max_range is not None and config.laser_max_range > log.laser.range_max:
        yield Finding(
            "noted", "parameters",
            f"laser_max_range = {config.laser_max_range:g} m is more than the laser's own {log.laser.range_max:g} m, "
            "which counts.",
            NOTHING,
        )  # fmt: skip


def _robot_itself(log: Log, rows: Any) -> Iterator[Finding]:
    if not log.wheels or _driven(log) < DROVE:
        return
    there = np.isfinite(rows)
    often = there.mean(axis=0) > 0.95
    filled = np.where(there, rows, np.float32(0.0))
    count = np.maximum(there.sum(axis=0), 1)
    mean = filled.sum(axis=0) / count
    spread = np.sqrt(np.maximum((filled**2).sum(axis=0) / count - mean**2, 0.0))
    own = often & (mean < OWN_D) & (spread < OWN_SPREAD)
    if (share := float(own.mean())) > OWN:
        near = float(mean[own].max())
        yield Finding(
            "doubtful", "laser",
            f"{100 * share:.0f} % of the beams always end {near:.2f} m or less away while the robot drives: they see "
            "the robot itself.",
            f"Leave them out: --set laser_min_range={near + 0.05:.2f}.",
        )  # fmt: skip


def _hanging(log: Log) -> Iterator[Finding]:
    if not log.wheels or len(log) < 3:
        return
    alike = (log.ranges[1:] == log.ranges[:-1]) | (np.isnan(log.ranges[1:]) & np.isnan(log.ranges[:-1]))
    same = alike.all(axis=1) & np.isfinite(log.ranges[1:]).any(axis=1)
    moved = np.abs(np.diff(log.odometry, axis=0)).max(axis=1) > MOVED
    share = float(np.mean(same[moved])) if moved.any() else 0.0
    if share > HANGS:
        row = int(np.flatnonzero(same & moved)[0])
        yield Finding(
            "doubtful", "laser",
            f"{100 * share:.0f} % of the scans repeat the one before to the last digit although the wheels turned, "
            f"first at {log.times[row + 1]:.1f} s: the laser hangs.",
            "Look at the laser's cable and driver. Scans that are repeated say nothing of where the robot is.",
        )  # fmt: skip


def _driven(log: Log) -> float:
    return float(np.hypot(*np.diff(log.odometry[:, :2], axis=0).T).sum())
