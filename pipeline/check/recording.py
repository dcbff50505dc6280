"""What is in a recording, and when: topics, rates, gaps, clocks."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pipeline.check.findings import NOTHING, Finding
from pipeline.errors import MclError
from pipeline.logs import schema
from pipeline.logs.choice import SCAN_TYPES, readable
from pipeline.logs.messages import Log
from pipeline.logs.recorded import Messages, Recorded
from pipeline.logs.stretches import FAR, GAP, RESTART
from pipeline.motion.gaps import LONG, MOMENT, MOVED, TIMES, TURNED

HEADER_AT: Final = dict.fromkeys((*SCAN_TYPES, schema.ODOMETRY_TYPE, schema.IMU_TYPE), 4) | {schema.TF_TYPE: 8}
"""Types that localization reads, and at which byte of their messages the (first) stamp stands."""
CLOCKS = 0.3
"""s by which the stamps of scans and of odometry may come apart, measured by when both were written down. The wheels'
own delay is told by the laser, more finely."""
TWICE = 0.05
"""Share of scans with the stamp of the one before from which on that is a fault."""
SHORT, FEW = 10.0, 20
"""s, scans: with less hardly any robot is found."""
LONGER = 5.0
"""s: loggers pause for up to 3.3 s (Intel) without anything being wrong."""
NAMED = 5
"""Gaps that are told one by one."""


@dataclass(frozen=True)
class SeenTopic:
    """One topic: its name, type, number of messages; of those that localization reads also when they were written down.

    ``times`` (n,) s since the first message of all, in the order of the file, None if they were not read; ``late`` (n,)
    s: how much later than its stamp each was written down, None where there are no stamps.
    """

    name: str
    type: str
    count: int
    times: NDArray[np.float64] | None = None
    late: NDArray[np.float64] | None = None

    @property
    def rate(self) -> float | None:
        """Messages per second, None if there are too few to tell."""
        if self.times is None or len(self.times) < 3 or self.times[-1] <= self.times[0]:
            return None
        return float((len(self.times) - 1) / (self.times[-1] - self.times[0]))

    @property
    def longest_gap(self) -> float | None:
        """Seconds of the longest silence between two messages, None if there are too few to tell."""
        return None if self.times is None or len(self.times) < 3 else float(np.diff(self.times).max())

    def to_dict(self) -> dict[str, Any]:
        """As plain values."""
        late = None if self.late is None else float(np.median(self.late))
        return {
            "name": self.name,
            "type": self.type,
            "messages": self.count,
            "rate": self.rate,
            "longest_gap": self.longest_gap,
            "written_after_stamp": late,
        }


def topics_of(recorded: Recorded) -> list[SeenTopic]:
    """Every topic of a recording; the messages of those that localization reads are looked at, cameras are not."""
    wanted = [t.name for t in recorded.topics.values() if t.type in HEADER_AT and readable(t)]
    read: dict[str, Messages] = {}
    for name in wanted:
        try:
            read |= recorded.messages([name])
        except MclError:  # which reading the log tells
            continue
    begin = min((int(said.log_times[0]) for said in read.values()), default=0)
    return [
        SeenTopic(t.name, t.type, t.count, *(_when(read[t.name], begin) if t.name in read else (None, None)))
        for t in recorded.topics.values()
    ]


def _when(said: Messages, begin: int) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    at = said.log_times
    steps = np.diff(at)
    steps = np.where((steps < -RESTART) | (steps > 1000 * FAR), GAP, np.maximum(steps, 0))
    first = int(at[0]) - begin
    times = np.concatenate([[0], np.cumsum(steps)]) / 1e9 + (first / 1e9 if abs(first) < 1000 * FAR else 0.0)
    stamps = np.array([_stamp(data, HEADER_AT[said.topic.type]) for data in said.data])
    stamped = np.isfinite(stamps) & (stamps != 0.0)
    # As float64, a stamp of today is good to a quarter of a microsecond.
    return times, (at / 1e9 - stamps) if stamped.all() else None


def _stamp(data: bytes, at: int) -> float:
    if len(data) < at + 8:
        return math.nan
    seconds, nanoseconds = struct.unpack_from("<iI" if data[1] & 1 else ">iI", data, at)
    return float(seconds) + nanoseconds / 1e9


def findings_of_times(log: Log) -> Iterator[Finding]:
    """What is wrong with when the scans were taken; needs nothing but the log."""
    if log.duration < SHORT or len(log) < FEW:
        yield Finding(
            "doubtful", "length", f"The log is short: {len(log):,} scans in {log.duration:.1f} s.",
            "Record until the robot has seen something that is in one place of the building only.",
        )  # fmt: skip
    intervals = np.diff(log.times)
    if not len(intervals):
        return
    usual = float(np.median(intervals))
    twice = float(np.mean(intervals <= 0.0))
    if twice > TWICE:
        yield Finding(
            "doubtful", "clocks", f"{100 * twice:.0f} % of the scans have the same stamp as the one before.",
            "Let the driver of the laser stamp each scan when it is measured.",
        )  # fmt: skip
    if usual >= MOMENT:
        yield Finding("noted", "laser", f"There is a scan every {usual:.1f} s only.", "Record every scan if you can.")
    yield from _gaps(log, usual)


def _gaps(log: Log, usual: float) -> Iterator[Finding]:
    long = np.flatnonzero(np.diff(log.times) > max(LONG, TIMES * usual))
    if log.stretches is not None:
        long = long[log.stretches[long] == log.stretches[long + 1]]
    seconds = np.diff(log.times)[long]
    if len(pauses := seconds[seconds < LONGER]):
        times = "once" if len(pauses) == 1 else f"{len(pauses)} times"
        text = f"There is no scan for a moment {times}, for {pauses.max():.1f} s at most."
        yield Finding("noted", "gaps", text, NOTHING)
    long = long[seconds >= LONGER]
    for row in long[:NAMED].tolist():
        begin, end = float(log.times[row]), float(log.times[row + 1])
        step = log.odometry[row + 1] - log.odometry[row]
        still = log.wheels and math.hypot(*step[:2]) < MOVED and abs(math.remainder(step[2], math.tau)) < TURNED
        wheels = ", and the wheels stood still meanwhile, as those of a robot that is carried" if still else ""
        yield Finding(
            "doubtful",
            "gaps",
            f"There is no scan for {end - begin:.1f} s, from {begin:.1f} s to {end:.1f} s{wheels}.",
            "Were lines deleted, or the recorder paused? If the robot was carried off, it has to be found again, which "
            "is tried.",
            (begin, end),
        )
    if len(long) > NAMED:
        yield Finding("doubtful", "gaps", f"There are {len(long) - NAMED} more such gaps.", "The page shows them all.")


def findings_of_clocks(log: Log, topics: list[SeenTopic], scan_topic: str, odometry_topic: str) -> Iterator[Finding]:
    """Whether scans and odometry are stamped by one clock, and whether odometry is there when scans are."""
    outside = int(log.metadata.get(schema.READER, {}).get("scans_outside_odometry", "0"))
    if outside:
        share = outside / (outside + len(log))
        yield Finding(
            "doubtful" if share > 0.1 else "noted", "odometry",
            f"{outside:,} of {outside + len(log):,} scans are from before the odometry begins or after it ends, and "
            "are not used.",
            "Start the base before the recorder." if share > 0.1 else NOTHING,
        )  # fmt: skip
    by_name = {topic.name: topic for topic in topics}
    scans, wheels = by_name.get(scan_topic), by_name.get(odometry_topic)
    if log.stretches is None and wheels is not None and wheels.times is not None and len(wheels.times) > 2:
        yield from _silences(wheels, scans)
    if scans is None or wheels is None or scans.late is None or wheels.late is None:
        return
    apart = float(np.median(wheels.late) - np.median(scans.late))
    if abs(apart) > CLOCKS:
        way = "behind" if apart > 0.0 else "ahead of"
        yield Finding(
            "doubtful", "clocks",
            f"The stamps of {wheels.name} are {abs(apart):.2f} s {way} those of {scans.name}, by when both were "
            "written down.",
            "Two computers, two clocks? Let them agree (chrony, NTP); for this log try --stamps log.",
        )  # fmt: skip
    drift = _drift(wheels) - _drift(scans)
    if abs(drift) > CLOCKS:
        yield Finding(
            "doubtful", "clocks",
            f"The clocks of {wheels.name} and {scans.name} come apart by {abs(drift):.2f} s in the course of the log.",
            "Let the computers agree on the time (chrony, NTP); for this log try --stamps log.",
        )  # fmt: skip


def _drift(topic: SeenTopic) -> float:
    assert topic.late is not None
    quarter = max(1, len(topic.late) // 4)
    return float(np.median(topic.late[-quarter:]) - np.median(topic.late[:quarter]))


def _silences(wheels: SeenTopic, scans: SeenTopic | None) -> Iterator[Finding]:
    """Where the odometry says nothing though there are scans."""
    assert wheels.times is not None
    steps = np.diff(wheels.times)
    begins = np.flatnonzero(steps > max(LONG, TIMES * float(np.median(steps))))
    if scans is not None and scans.times is not None:
        at = np.sort(scans.times)
        within = np.searchsorted(at, wheels.times[begins + 1], "left") - np.searchsorted(
            at, wheels.times[begins], "right"
        )
        begins = begins[within > 0]
    if len(begins):
        row = int(begins[np.argmax(steps[begins])])
        times = "once" if len(begins) == 1 else f"{len(begins)} times"
        yield Finding(
            "doubtful",
            "gaps",
            f"{wheels.name} is silent {times} while there are scans, longest for {steps[row]:.1f} s, "
            f"{wheels.times[row]:.1f} s after the recording began.",
            "Was the base restarted? Scans in between get odometry drawn straight across.",
        )
