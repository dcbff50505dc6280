"""A drive through the embedded office as some other robot would have recorded it: what is hard is then done to it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from converters.cmu_text import MAX_RANGE_CM, CmuLog, read_log_text
from pipeline.logs.messages import Log
from pipeline.logs.reader import read_log
from pipeline.logs.recorded import Names
from pipeline.simulate import sample_dir
from recordings import UPRIGHT, Recording

SECOND = 1_000_000_000
START = 1_700_000_000 * 1_000_000_000
FRAMES = ("odom", "base_link")
MOUNT = (0.25, 0.0, 0.3)


@cache
def sample() -> CmuLog:
    return read_log_text(sample_dir() / "office.log.gz")


@dataclass(frozen=True)
class Moment:
    """A scan with the odometry at its stamp: ns, (m, m, rad), metres."""

    stamp: int
    pose: tuple[float, float, float]
    ranges: list[float]


@cache
def moments(count: int = 60, every: int = 4) -> tuple[Moment, ...]:
    log = sample()
    rows = np.flatnonzero(log.is_scan)[: count * every : every]
    scans = np.flatnonzero(np.isin(np.flatnonzero(log.is_scan), rows))
    found = []
    for row, scan in zip(rows.tolist(), scans.tolist(), strict=True):
        x, y, yaw = (log.poses[row] / [100.0, 100.0, 1.0]).tolist()
        ranges = np.where(log.ranges[scan] > MAX_RANGE_CM, np.inf, log.ranges[scan] / 100.0)
        found.append(Moment(START + int(log.stamps[row]), (x, y, yaw), ranges.tolist()))
    return tuple(found)


def scan(recording: Recording, moment: Moment, stamp: int | None = None, **other: object) -> None:
    options: dict[str, object] = {"first": -np.pi / 2, "step": np.radians(1.0), "limits": (0.0, 81.8)}
    options |= {"frame": "laser", "topic": "/scan", "time_increment": 0.0} | other
    recording.scan(moment.stamp if stamp is None else stamp, moment.ranges, **options)  # type: ignore[arg-type]


def drive(prefix: str = "", mount: tuple[float, float, float] = MOUNT) -> Iterator[tuple[Recording, Moment]]:
    """Scans and odometry one after the other; whoever iterates adds what there is besides, or instead."""
    recording = Recording()
    recording.transforms(("base_link", "laser", mount, UPRIGHT), topic=f"{prefix}/tf_static")
    for moment in moments():
        yield recording, moment


def ordinary_drive(prefix: str = "", mount: tuple[float, float, float] = MOUNT, bend: float = 0.0) -> Recording:
    recording = Recording()
    for recording, moment in drive(prefix, mount):
        x, y, yaw = moment.pose
        recording.odometry(moment.stamp, x, y + bend * x, yaw, topic=f"{prefix}/odom", frames=FRAMES)
        scan(recording, moment, topic=f"{prefix}/scan")
    return recording


def looped(times: int, received: bool, imu: bool = False) -> Recording:
    """The same drive so many times over; ``received``: written down by a clock that goes on."""
    recording = Recording()
    recording.transforms(("base_link", "laser", (0.25, 0.0, 0.3), UPRIGHT))
    length = moments()[-1].stamp - START + SECOND
    for k in range(times):
        for moment in moments():
            recording.odometry(moment.stamp, *moment.pose, topic="/odom", frames=FRAMES)
            scan(recording, moment)
            for i in range(4 if imu else 0):
                recording.imu(moment.stamp + i * SECOND // 5, (0.0, 0.0, 0.1), frame="base_link")
        if received:
            mine = len(moments()) * (6 if imu else 2)
            later = [(t, kind, at + k * length, n, data) for t, kind, at, n, data in recording.entries[-mine:]]
            recording.entries[-mine:] = later
    return recording


def read(recording: Recording, tmp_path: Path, **names: object) -> Log:
    return read_log(recording.write(tmp_path / "drive.mcap"), names=Names(**names))  # type: ignore[arg-type]


def remarks(log: Log) -> str:
    return log.metadata["reader"].get("remarks", "")


def steps(log: Log) -> np.ndarray:
    """The odometry from scan to scan, in the robot's frame."""
    from pipeline.geometry import between

    return between(log.odometry[:-1], log.odometry[1:])
