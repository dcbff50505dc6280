"""What the log has shown of the world so far, where that is not what the map says.

A scan is remembered in the frame of the laser's odometry, and says something of the world only once the place from
which it was taken has proved right, and the robot has gone on from there: a belief must not confirm itself by what it
has just written. When another place takes the belief's, what was written from there moves with it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.geometry import between, compose, inverse, wrap_angle
from pipeline.logs.messages import Laser
from pipeline.world.seen import Seen
from pipeline.world.world import World

Array = NDArray[np.float64]

KEY_D, KEY_A = 0.2, math.radians(10.0)
"""m, rad: a scan so far from the last one that is kept is kept, too."""
PROVED = 10.0
"""s for which a place must have been uncontested until it has proved right."""
RECENT = 10.0
"""s for which a scan says nothing yet of the world."""
CONTENT_D, CONTENT_A = 1.0, math.radians(17.0)
"""m, rad: if what was believed of a scan's place is farther off what is believed now, it was wrong."""
PAUSE = 5.0
"""s from one renewal of the world to the next."""


@dataclass(frozen=True)
class KeyScan:
    """A scan that is remembered: ``ranges`` (beams,) m, taken at ``time`` s from ``way`` (3,), the robot's pose by the
    laser's odometry, in its ``stretch``, which a break of that ends; ``believed`` (3,): where the belief had it, grid
    frame, None if that was found to be wrong."""

    time: float
    stretch: int
    way: Array
    ranges: NDArray[np.float32]
    believed: Array | None


class Memory:
    """Keeps key scans, and lets those speak for the ``world`` whose places have proved right."""

    def __init__(self, world: World, laser: Laser, before: Seen | None = None) -> None:
        self._world, self._laser = world, laser
        if before is not None:
            world.begin_with(before)
        self._pending: list[KeyScan] = []
        self._written: list[tuple[KeyScan, Array]] = []
        self._key: KeyScan | None = None
        self._settled = math.inf
        self._heard = self._stretch = 0
        self._renewed = 0.0
        self._unspoken = False
        self._time = 0.0

    @property
    def seen(self) -> Seen:
        """What the scans of this run have shown of the world so far, without what it began with."""
        return self._world.own

    @property
    def scans(self) -> int:
        """How many scans speak for the world."""
        return len(self._written)

    def follow(self, scan: KeyScan, settled: bool) -> None:
        """Hear of a scan and of where it is believed to have been taken; ``settled``: that nothing contests it."""
        self._time = scan.time
        if self._key is None or scan.stretch != self._heard:  # a gap ends a stretch, too
            self._key, self._heard, self._stretch = None, scan.stretch, self._stretch + 1
        scan = replace(scan, stretch=self._stretch)
        if not settled:
            self._settled = math.inf
        self._settled = min(self._settled, scan.time)
        step = None if self._key is None else between(self._key.way, scan.way)
        if step is None or math.hypot(step[0], step[1]) > KEY_D or abs(float(wrap_angle(step[2]))) > KEY_A:
            self._key = scan
            self._pending.append(scan)
        if settled and scan.time - self._settled > PROVED:
            self._write(scan, scan.time - RECENT)
        if self._unspoken and scan.time - self._renewed > PAUSE:
            self._renew()

    def close(self) -> None:
        """The way is broken off: what has proved right so far speaks at once, the rest never will."""
        if self._pending and self._time - self._settled > PROVED:
            self._write(self._pending[-1], math.inf)
        self._pending, self._key, self._settled = [], None, math.inf
        if self._unspoken:
            self._renew()

    def moved(self) -> None:
        """The belief is elsewhere now: what was written on this stretch waits until its new place has proved right."""
        self._settled = math.inf
        if self._key is None:  # nothing was seen since a gap: what was written before it stays
            return
        stretch = self._stretch
        self._pending = [replace(scan, believed=None) for scan in self._pending]
        wrong = [replace(scan, believed=None) for scan, _ in self._written if scan.stretch == stretch]
        if wrong:
            self._pending = wrong + self._pending
            self._written = [(scan, at) for scan, at in self._written if scan.stretch != stretch]
            self._world.forget()
            for scan, at in self._written:
                self._look(scan, at)
            self._renew()

    def _write(self, now: KeyScan, until: float) -> None:
        assert now.believed is not None
        to_grid = compose(now.believed, inverse(now.way))
        waiting = []
        for scan in self._pending:
            if scan.time > until:
                waiting.append(scan)
                continue
            at = scan.believed
            if scan.stretch == now.stretch:
                carried = compose(to_grid, scan.way)
                if at is None or _apart(at, carried):
                    at = carried
            if at is not None:
                self._written.append((scan, at))
                self._look(scan, at)
                self._unspoken = True
        self._pending = waiting

    def _look(self, scan: KeyScan, at: Array) -> None:
        self._world.look(compose(at, self._laser.pose), self._laser.angles, scan.ranges)

    def _renew(self) -> None:
        self._world.renew()
        self._unspoken, self._renewed = False, self._time


def _apart(a: Array, b: Array) -> bool:
    step = between(a, b)
    return math.hypot(step[0], step[1]) > CONTENT_D or abs(float(wrap_angle(step[2]))) > CONTENT_A
