"""The wheels against the laser: both witnesses are heard over the whole log, and whatever they contradict is told."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from pipeline.check.findings import NOTHING, Finding, Grade
from pipeline.config import Config
from pipeline.logs.messages import Log
from pipeline.motion.faults import Fault, Kind
from pipeline.motion.witnesses import Witnesses

ADVICE: Final[dict[Kind, tuple[Grade, str]]] = {
    "dead": ("doubtful", "Look at the base's driver and cable. Meanwhile the laser alone tells the motion."),
    "mirrored": (
        "broken",
        "Is a motor's sign, or left and right, exchanged in the base's driver? Or is the laser upside down, and no "
        "transform says so? Mend it; until then the turns are corrected.",
    ),
    "no_reverse": ("doubtful", "The base counts without sign when it backs up: mend its driver."),
    "scale": ("doubtful", "Correct the wheels' radius, or the ticks per turn; until then the metres are corrected."),
    "late": ("doubtful", "Stamp the odometry when it is measured, not when it is sent; or --stamps log."),
    "slipped": ("noted", NOTHING),
    "restarted": ("doubtful", "The base's driver was restarted. The step is left out."),
    "turned": ("broken", "Measure how the laser is mounted and give it: --laser-pose X,Y,YAW."),
}
"""Of each fault its grade, and what to do."""
OFTEN = 5
"""So many slips are a floor, or wheels, to be looked at."""
NAMED = 3
"""Faults of one kind that are told one by one."""
BLIND = 0.3
"""Share of the scans that laser odometry cannot place, from which on there is something wrong with them."""


@dataclass(frozen=True)
class Heard:
    """What the witnesses said: metres ``driven`` by each, the share of scans in which the laser was ``blind``."""

    wheels: float | None
    laser: float
    blind: float
    findings: tuple[Finding, ...]


def hear(log: Log, config: Config) -> Heard:
    """Hear wheels and laser over the whole log, as a run does, and tell the faults that they show."""
    heard = config.model_copy(update={"odometry": "both"})
    log = log.without_short(config.laser_min_range)
    witnesses = Witnesses(log.laser, heard, wheels=log.wheels)
    faults: list[tuple[float, Fault]] = []
    blind, way = 0, np.zeros((len(log), 3))
    for i, scan in enumerate(log.scans()):
        motion = witnesses.update(scan)
        faults += [(motion.time, fault) for fault in motion.faults]
        blind += motion.laser is not None and motion.laser.blind
        way[i] = motion.laser_pose
    found = [*_named(faults), *_dead_to_the_end(log, faults)]
    share = blind / max(1, len(log))
    if share > BLIND:
        found.append(Finding(
            "doubtful", "laser", f"In {100 * share:.0f} % of the scans there is too little to tell the motion by.",
            "Look at the laser's range and window. In a hall larger than its range this is no fault.",
        ))  # fmt: skip
    wheels = _length(log.odometry) if log.wheels else None
    return Heard(wheels, _length(way), share, tuple(found))


def findings_of_transforms(log: Log) -> Iterator[Finding]:
    """Whether it is known how the laser sits on the robot, and whether there is odometry at all."""
    told = log.told
    if why := told.get("laser_at_centre"):
        yield Finding(
            "doubtful", "transforms", f"The laser is taken to be at the robot's centre: {why}.",
            "Measure where it sits, and give --laser-pose X,Y,YAW (m, rad) or --tf FILE.",
        )  # fmt: skip
    if not log.wheels:
        yield Finding(
            "noted", "odometry", "There is no odometry: the laser alone tells the motion.",
            "Record the odometry as well if the robot has wheels; halls larger than the laser's range need it.",
        )  # fmt: skip
    if wrong := told.get("imu_unused"):
        yield Finding("noted", "gyroscope", f"The gyroscope is not used: {wrong}.", NOTHING)
    if left_out := int(told.get("imu_left_out", "0")):
        yield Finding(
            "noted", "gyroscope", f"{left_out:,} messages of the gyroscope are left out: no turn rates.", NOTHING
        )


def _named(faults: list[tuple[float, Fault]]) -> Iterator[Finding]:
    for kind, (grade, do) in ADVICE.items():
        told = [(time, fault) for time, fault in faults if fault.kind == kind]
        if kind == "slipped" and len(told) > OFTEN:
            grade, do = "doubtful", "Slippery floor, thresholds, or spinning wheels? Drive more slowly there."
        for time, fault in told[:NAMED]:
            yield Finding(grade, "odometry", fault.text, do, (time, time))
        if rest := told[NAMED:]:
            times = ", ".join(f"{time:.1f}" for time, _ in rest[:20]) + (" ..." if len(rest) > 20 else "")
            text = f"{len(rest)} more times: {kind.replace('_', ' ')}, at {times} s."
            yield Finding(grade, "odometry", text, do, (rest[0][0], rest[-1][0]))


def _dead_to_the_end(log: Log, faults: list[tuple[float, Fault]]) -> Iterator[Finding]:
    """Wheels that say nothing for most of the log are none."""
    dead = [time for time, fault in faults if fault.kind == "dead"]
    still = np.abs(log.odometry - log.odometry[-1]).max(axis=1) < 1e-3
    since = float(log.times[int(np.flatnonzero(~still)[-1]) + 1]) if not still.all() else 0.0
    if log.wheels and dead and log.duration - since > 0.5 * log.duration:
        yield Finding(
            "broken", "odometry", f"From {since:.1f} s to the end, at {log.duration:.1f} s, the wheels say nothing.",
            "Mend the base's driver; or convert --without-odometry, and the laser alone tells the motion.",
            (since, log.duration),
        )  # fmt: skip


def _length(poses: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    """Metres, from places half a metre apart: a laser that trembles goes nowhere."""
    metres, at = 0.0, poses[0, :2]
    for place in poses[:, :2]:
        step = math.hypot(*(place - at))
        if step > 0.5:
            metres, at = metres + step, place
    return metres
