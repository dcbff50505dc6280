"""Gaps: moments at which nobody saw how the robot moved, so that it may have been driven, or carried, anywhere."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.geometry import between, wrap_angle
from pipeline.motion.laser_odometry import GOOD, Match

Array = NDArray[np.float64]

LONG, TIMES = 2.5, 5.0
"""s, and multiples of the usual time between two scans: a scan that comes later than both has a gap before it. Loggers
pause for up to 1.4 s (Intel), and some recordings have a scan every five seconds."""
MOMENT = 1.0
"""s: where scans are farther apart than this as a rule, robots often drive to where they see other walls."""
MOVED, TURNED = 0.3, 0.3
"""m, rad: wheels that say less stood still."""


@dataclass(frozen=True)
class Gap:
    """Why nobody saw the way from the scan before: ``seconds`` since then; ``told`` (3,) m, m, rad, the step that the
    wheels say, None if they say nothing.

    ``kind``: "missing", there was no scan for a while; "unmatched", the laser sees walls that it has never seen, from
    one scan to the next; "sparse", the same in a log whose scans are so far apart that this is no wonder. ``bridged``:
    this scan shows walls that were seen before, so that the laser knows where it is.
    """

    kind: Literal["missing", "unmatched", "sparse"]
    seconds: float
    told: Array | None
    bridged: bool = False

    @property
    def driven(self) -> bool:
        """Whether the wheels say that the robot drove on unseen. Those of a robot that is carried stand still."""
        told = self.told
        return told is not None and bool(math.hypot(*told[:2]) > MOVED or abs(told[2]) > TURNED)


class Gaps:
    """Finds the gaps in a log as it is read; an answer depends on nothing that comes later."""

    def __init__(self) -> None:
        self._usual: float | None = None

    def update(self, seconds: float, told: Array | None, before: Match, now: Match) -> Gap | None:
        """The gap between two scans, so many ``seconds`` apart, if there is one. ``told``: the wheels' step."""
        usual = self._usual
        missing = usual is not None and seconds > max(LONG, TIMES * usual)
        if not missing:
            # A tenth of each new interval: loggers change their pace.
            self._usual = seconds if usual is None else usual + 0.1 * (seconds - usual)
        parted = now.stretch != before.stretch
        if missing:
            # In a window as wide as it is after so long a time something always fits by chance.
            return Gap("missing", seconds, told, bridged=not parted and not now.wide and now.fit >= GOOD)
        if usual is None or told is None:
            return None
        if (parted and not now.blind) or (
            now.wide and now.fit < GOOD and not _agree(between(before.pose, now.pose), told)
        ):
            return Gap("unmatched" if usual < MOMENT else "sparse", seconds, told)
        return None


def _agree(seen: Array, told: Array) -> bool:
    """Whether a poor match is where the wheels say: then the robot drove on, to where it sees much that is new."""
    apart = seen - told
    return bool(math.hypot(*apart[:2]) < MOVED and abs(float(wrap_angle(apart[2]))) < TURNED)
