"""Where stamps begin anew: a simulation was reset, a recording played in a loop, a file put behind another one.

What follows is a new stretch. It is put behind the one before, in the order of the file, ten seconds later; intervals
within it stay what they were. Messages that come a little late are no new stretch, and are sorted in.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.logs.columns import GyroscopeColumns, PoseColumns, ScanColumns

RESTART = 2_000_000_000
"""ns by which stamps must run back to begin anew: a message that comes late is less late than that."""
STRAY = 3
"""So many messages in a row may have a stamp of their own kind without the clock having been set."""
FAR = 60_000_000_000
"""ns: a stray stamp that far away says nothing of when the message was sent."""
GAP = 10_000_000_000
"""ns between the last message of a stretch and the first of the next one: long enough to be seen as a gap."""

Stamps = NDArray[np.int64]
Columns = TypeVar("Columns", ScanColumns, PoseColumns, GyroscopeColumns)


def numbered(stamps: Stamps) -> Stamps | None:
    """The stretch (n,) of every message of a topic, in the order of the file, from 0; -1: a stamp from nowhere.

    None if there is one stretch only.
    """
    if len(stamps) == 0 or (stamps >= np.maximum.accumulate(stamps) - RESTART).all():
        return None
    times, numbers = stamps.tolist(), [0]
    highest: list[int] = [times[0]]  # so far, in this stretch
    inside = [0]  # the stretch's messages
    for i in range(1, len(times)):
        if times[i] >= highest[-1] - RESTART:
            numbers.append(numbers[inside[-1]])
        elif (ahead := _ahead(times[i], highest)) > 0:
            for stray in inside[-ahead:]:
                if times[stray] - times[i] > FAR:
                    numbers[stray] = -1
            del inside[-ahead:], highest[-ahead:]
            numbers.append(numbers[inside[-1]])
        elif any(later >= highest[-1] - RESTART for later in times[i + 1 : i + 1 + STRAY]):
            if highest[-1] - times[i] > FAR:
                numbers.append(-1)
                continue
            numbers.append(numbers[inside[-1]])
        else:
            numbers.append(numbers[inside[-1]] + 1)
            inside, highest = [i], [times[i]]
            continue
        inside.append(i)
        highest.append(max(highest[-1], times[i]))
    return np.array(numbers, np.int64)


def _ahead(time: int, highest: list[int]) -> int:
    """How many of the last messages, after a leap, are of the future, if not the one of ``time`` is of the past."""
    for count in range(1, min(STRAY, len(highest) - 1) + 1):
        before = highest[-1 - count]
        if time >= before - RESTART and highest[-count] > before + RESTART:
            return count
    return 0


@dataclass(frozen=True)
class Clock:
    """One time for all stretches: ``shifts`` (k,) ns to add to the stamps of each, ``begins`` (k,) ns."""

    shifts: Stamps
    begins: Stamps

    def __call__(self, columns: Columns) -> Columns:
        """The same with stamps of the one time; ``stretch`` is kept."""
        if columns.stretch is None or len(self.shifts) == 1:
            return columns
        number = np.minimum(columns.stretch, len(self.shifts) - 1)
        return replace(columns, stamps=columns.stamps + self.shifts[number], stretch=number)


def one_time(scans: ScanColumns, *others: PoseColumns | GyroscopeColumns | None) -> Clock:
    """The clock of a recording whose scans, and others, begin anew together."""
    if scans.stretch is None:
        return Clock(np.zeros(1, np.int64), np.array([scans.stamps.min(initial=0)]))
    all_columns = [scans, *(c for c in others if c is not None and c.stretch is not None)]
    shifts: list[int] = []
    begins: list[int] = []
    end = 0
    for k in range(int(scans.stretch.max()) + 1):
        parts = [c.stamps[c.stretch == k] for c in all_columns if c.stretch is not None]
        first, last = min(int(p.min()) for p in parts if len(p)), max(int(p.max()) for p in parts if len(p))
        shifts.append(0 if k == 0 else end + GAP - first)
        begins.append(first + shifts[-1])
        end = last + shifts[-1]
    return Clock(np.array(shifts, np.int64), np.array(begins, np.int64))


def stretches_of(stamps: Stamps, begins: Stamps) -> Stamps:
    """The stretch (n,) in which stamps of the one time lie."""
    return np.maximum(np.searchsorted(begins, stamps, side="right") - 1, 0)


def as_record(begins: Stamps) -> dict[str, str]:
    """When stretches begin, as a metadata record."""
    return {str(k): str(stamp) for k, stamp in enumerate(begins.tolist())}


def from_record(record: Mapping[str, str]) -> Stamps:
    """When stretches begin, from the record that ``as_record`` made."""
    return np.array(sorted(int(stamp) for stamp in record.values()), np.int64)


def begins_after(stamps: Stamps, stretches: Stamps) -> list[float]:
    """Seconds from the first of the scans' ``stamps`` (n,) to the first of every later stretch (n,)."""
    return ((stamps[np.flatnonzero(np.diff(stretches)) + 1] - stamps[0]) / 1e9).tolist()


def alongside(scans: ScanColumns, other: Columns) -> Columns:
    """Of a topic with several stretches that which the scans overlap, where these have one only; else all of it."""
    if scans.stretch is not None or other.stretch is None:
        return other
    first, last = scans.stamps.min(), scans.stamps.max()
    within = (other.stamps >= first) & (other.stamps <= last)
    best = int(np.argmax(np.bincount(other.stretch, weights=within)))
    return replace(other.take(other.stretch == best), stretch=None)


def told(topic: str, stamps: Stamps, stretch: Stamps, clock: Clock) -> str:
    """One line that says where stretches begin; ``stamps`` (n,) and ``stretch`` (n,) in the order of the file."""
    places = []
    for k in range(1, len(clock.shifts)):
        at = int(np.flatnonzero(stretch == k)[0])
        back = (int(stamps[stretch == k - 1][-1]) - int(stamps[at])) / 1e9
        places.append(f"by {back:.1f} s at message {at + 1:,}")
    listed = ", ".join(places[:3]) + (f" and {len(places) - 3} times more" if len(places) > 3 else "")
    last = "it" if len(places) == 1 else "each"
    return (
        f"the stamps of {topic} run back {listed}: {last} begins a new stretch, 10 s after the one before, and nobody "
        "knows how the robot got there"
    )
