"""What followed a fault: whether the robot was found again, and after how many seconds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pipeline.evaluate.metrics import LOCALIZED, Array, Mask, Summary, known, pose_errors
from pipeline.logs.faults import Fault

STAYS = 10.0
"""s for which the pose must stay right for the robot to count as found again."""
AT_ONCE = 2
"""Found from the second scan on, or from the first: the fault did no harm that lasts."""
FAULT_COLUMNS = ("log", "fault", "times", "found again", "in two scans", "after (s)", "p95")
"""Headings of ``fault_table``."""

Row = tuple[str, ...]


@dataclass(frozen=True)
class Aftermath:
    """What followed a fault: ``fault`` its name, ``placed`` the fault with all numbers, ``at`` when it can be seen, s.

    ``time``: seconds until the pose was right and stayed so for 10 s, before the next fault; ``scans``: the number of
    that scan, 1 for the first one that can show the fault. Both None where that never happened.
    """

    fault: str
    placed: str
    at: float
    time: float | None
    scans: int | None


def aftermaths(
    times: Array,
    poses: Array,
    truth: Array,
    faults: Sequence[Fault],
    limits: tuple[float, float] = LOCALIZED,
) -> tuple[Aftermath, ...]:
    """What followed each of the faults that begin after the first scan, in the order of time.

    ``times`` (n,) s; ``poses``, ``truth`` (n, 3) m, rad, NaN where unknown, which is neither right nor wrong.
    ``limits``: m, rad within which a pose is right.
    """
    position, heading = pose_errors(poses, truth)
    wrong = known(truth) & ~((position <= limits[0]) & (heading <= limits[1]))
    right = known(truth) & ~wrong
    result = []
    for moment, fault in sorted(_moments(faults), key=lambda each: each[0]):
        later = [other.begin for _, other in _moments(faults) if other.begin > moment]
        until = min([*later, float(times[-1])])
        first = int(np.searchsorted(times, moment))
        found = _found(times, right, wrong, first, until)
        time, scans = (None, None) if found is None else (float(times[found]) - moment, found - first + 1)
        result.append(Aftermath(fault.name, fault.text, moment, time, scans))
    return tuple(result)


def _moments(faults: Sequence[Fault]) -> list[tuple[float, Fault]]:
    return [(fault.moment, fault) for fault in faults if fault.moment is not None]


def _found(times: Array, right: Mask, wrong: Mask, first: int, until: float) -> int | None:
    """The first scan from ``first`` on from which on none of 10 s is wrong, all before ``until``."""
    errs = times[np.flatnonzero(wrong)]
    for k in range(first, len(times)):
        if times[k] + STAYS > until:
            return None
        if right[k]:
            following = int(np.searchsorted(errs, times[k]))
            if following == len(errs) or errs[following] > times[k] + STAYS:
                return k
    return None


def aftermath_row(name: str, these: Sequence[Aftermath]) -> Row:
    """What followed all faults of one name, as texts under FAULT_COLUMNS but its first."""
    told = plain_aftermath(name, these)
    time = told["time"]
    seconds = ("-", "-") if time is None else (f"{time['median']:.1f}", f"{time['p95']:.1f}")
    found, at_once = told["found_again"], told["at_once"]
    return (name, str(len(these)), f"{found / len(these):.1%}", f"{at_once / len(these):.1%}", *seconds)


def plain_aftermath(name: str, these: Sequence[Aftermath]) -> dict[str, Any]:
    """The same as plain values: how often the fault was made, found again, at once, and after how many seconds."""
    time = Summary.of([each.time for each in these if each.time is not None])
    return {
        "fault": name,
        "times": len(these),
        "found_again": sum(each.time is not None for each in these),
        "at_once": sum(each.scans is not None and each.scans <= AT_ONCE for each in these),
        "time": None if time is None else asdict(time),
    }
