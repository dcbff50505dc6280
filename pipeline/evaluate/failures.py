"""Failures on the way, after Fox, Burgard and Thrun (JAIR 11, 1999, Section 5): how often is the robot found again?

The article makes them in logs of a real robot: at so many places per metre the position is shifted or the robot turned
round, without its odometry saying so. Here the log keeps its scans and its truth, and its odometry is made to tell a
turn of 180 degrees or a shift that did not happen. A laser that sees the same walls before and after contradicts that;
so a third of the failures are of another kind, which nothing but the map can tell: the robot is put elsewhere, and the
log goes on with scans from there.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluate.metrics import Array, known
from pipeline.logs.faults import MARGIN, Fault

TURNED: Final = "turned by 180 degrees"
SHIFTED: Final = "shifted"
ELSEWHERE: Final = "put elsewhere"
FAILURES: Final = (TURNED, SHIFTED, ELSEWHERE)
ANY: Final = "any failure"
RECOVERED: Final = (0.45, np.pi)
"""m, rad: the article asks for the position only."""
ENOUGH: Final = 50
"""Failures from which on a share is worth telling."""
LEAST: Final = 30.0
"""s of the log that must lie ahead of where a robot is put."""
FAR: Final = 2.0
"""m from where the robot was to where it is put, at least."""


def draw_failures(times: Array, truth: Array, rate: float, seed: int) -> tuple[Fault, ...]:
    """Failures at ``rate`` per metre of the true way, placed, in the order of time; the seed decides all of it.

    ``times`` (n,) s and ``truth`` (n, 3) m, rad of the log's scans. Distances between failures are exponential; none
    comes in the first 15 s, the last 15 s, or within 15 s of another. Each kind is as likely as the others.
    """
    rng = np.random.default_rng([seed, 1999])
    steps = np.hypot(*np.diff(truth[:, :2], axis=0).T)
    way = np.concatenate([[0.0], np.cumsum(np.nan_to_num(steps))])
    faults: list[Fault] = []
    shift, last = 0.0, 0.0  # s that scans are later than they were recorded; when the failure before this one was
    while True:
        since = min(int(np.searchsorted(times + shift, last + MARGIN)), len(times) - 1)
        row = int(np.searchsorted(way, way[since] + rng.exponential(1.0 / rate)))
        end = min(times[-1], times[-1] + shift)
        if row >= len(times) or times[row] + shift > end - MARGIN:
            return tuple(faults)
        now = float(times[row] + shift)
        last = math.floor(1000.0 * now) / 1000.0
        name, drawn = FAILURES[int(rng.integers(len(FAILURES)))], rng.random(3)
        elsewhere = _elsewhere(times, truth, row) if name == ELSEWHERE else None
        if elsewhere is not None and len(elsewhere):
            there = float(times[elsewhere[int(drawn[0] * len(elsewhere))]])
            shift = now - there
            faults.append(Fault("jump", (last, math.floor(1000.0 * there) / 1000.0), ELSEWHERE))
        elif name == SHIFTED:
            metres, direction = 0.5 + 2.5 * drawn[1], 2.0 * np.pi * drawn[2]
            shifted = (float(metres * np.cos(direction)), float(metres * np.sin(direction)))
            faults.append(Fault("slide", (last, *shifted), SHIFTED))
        else:
            faults.append(Fault("turn", (last, 180.0), TURNED))


def _elsewhere(times: Array, truth: Array, row: int) -> NDArray[np.int64]:
    """Scans at whose places the robot may be put."""
    with np.errstate(invalid="ignore"):
        far = np.hypot(*(truth[:, :2] - truth[row, :2]).T) >= FAR
    return np.flatnonzero(known(truth) & far & (times <= times[-1] - LEAST))
