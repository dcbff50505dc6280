"""The two witnesses of motion: what the wheels say, and what the laser says. Needs no map."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.geometry import between, compose
from pipeline.logs.leaps import leapt
from pipeline.logs.messages import Laser, Scan
from pipeline.motion.deskew import Deskewer
from pipeline.motion.faults import Fault, Faults, Step, leap
from pipeline.motion.gaps import MOMENT, Gap, Gaps
from pipeline.motion.laser_odometry import LaserOdometry, Match

Array = NDArray[np.float64]
SOUND = 0.7
"""Fit of two matches from which on the step between them may show a fault of the wheels."""


@dataclass(frozen=True)
class Motion:
    """What is known of the motion up to one scan: poses (3,) m, m, rad, each in a frame of its own.

    ``odometry``: as the wheels say, None without wheels; ``laser``: the match of the laser's odometry, None if only the
    wheels are heard; ``turn``: heading by a gyroscope, rad, None without one; ``pose``: dead reckoning by both, which
    starts where the odometry does; ``time``: seconds since the first scan. ``ranges`` (beams,) float32 m: the scan as
    it is seen from where the robot was at its stamp; ``blind``: seconds since the laser last told the robot's speed in
    all directions; ``gap``: that nobody saw the way from the scan before; ``faults`` of the wheels that this scan has
    shown: ``odometry`` is what is left when they are mended; ``unheard``: how many steps the wheels have not told so
    far; ``late``: s, by which they are behind the laser, if that is a fault.
    """

    time: float
    odometry: Array | None
    laser: Match | None
    turn: float | None
    pose: Array
    ranges: NDArray[np.float32]
    blind: float = 0.0
    gap: Gap | None = None
    faults: tuple[Fault, ...] = ()
    unheard: int = 0
    late: float = 0.0

    def __repr__(self) -> str:
        x, y, yaw = self.pose
        return f"Motion(at {self.time:.2f} s: ({x:.2f}, {y:.2f}) m, {math.degrees(yaw):.0f} deg by dead reckoning)"

    @property
    def unseen(self) -> Gap | None:
        """The gap before this scan, if the laser does not know either where the robot is now."""
        return None if self.gap is None or self.gap.bridged else self.gap

    @property
    def laser_pose(self) -> Array:
        """Where the laser's own odometry says that the robot is, from where it was at the first scan."""
        return self.pose if self.laser is None else self.laser.pose


class Witnesses:
    """Hears the wheels and the laser at every scan; an answer depends on nothing that comes later."""

    def __init__(self, laser: Laser, config: Config, wheels: bool = True) -> None:
        self._wheels = wheels and config.odometry != "laser"
        self._laser = (
            LaserOdometry(laser, config.laser_max_range) if config.odometry != "wheels" or not wheels else None
        )
        self._deskewer = Deskewer(laser)
        self._without = config.without
        self._last: Motion | None = None
        self._gaps = Gaps()
        self._faults = Faults()
        self._recorded, self._unheard, self._mended = np.zeros(3), 0, False
        self._step, self._seconds, self._blind = np.zeros(3), 0.0, math.inf

    def update(self, scan: Scan) -> Motion:
        """What is known once this scan is in."""
        last = self._last
        seconds = scan.time - last.time if last is not None else 0.0
        faults, recorded = list[Fault](), None
        if self._wheels and last is not None:
            recorded = between(self._recorded, scan.odometry)
            if "faults" not in self._without and leapt(recorded, seconds):
                faults, recorded = [leap(scan.time, recorded, scan.odometry)], None
        if self._laser is None:
            odometry = self._odometry(scan, recorded, recorded)
            assert odometry is not None
            self._last = Motion(scan.time, odometry, None, scan.turn, odometry, scan.ranges, faults=tuple(faults))
            return self._last
        told = None if recorded is None or self._faults.dead else self._faults.mended(recorded)
        guesses = self._guesses(last, told, scan.turn, seconds)
        ranges = self._at_the_stamp(scan, guesses[0])
        match = self._laser.update(ranges, guesses, seconds, told is not None)
        if last is None:
            pose, gap = np.array(scan.odometry, np.float64), None
        else:
            assert last.laser is not None
            # Where no match holds, the laser's odometry has gone on as the first guess said.
            self._step, self._seconds = between(last.laser.pose, match.pose), seconds
            pose = compose(last.pose, self._step)
            known = match.open is None and match.stretch == last.laser.stretch
            self._blind = 0.0 if known else self._blind + seconds
            gap = None if "gaps" in self._without else self._gaps.update(seconds, told, last.laser, match)
            if gap is not None and not gap.bridged and match.stretch == last.laser.stretch:
                self._laser.begin_anew(ranges)
            if recorded is not None and "faults" not in self._without:
                sound = known and last.laser.open is None and gap is None and seconds < MOMENT
                sound &= min(match.fit, last.laser.fit) > SOUND
                faults += self._faults.update(Step(scan.time, seconds, recorded, self._step if sound else None))
        odometry = self._odometry(scan, told, recorded)
        self._last = Motion(
            scan.time, odometry, match, scan.turn, pose, ranges, self._blind, gap,
            tuple(faults), self._unheard, self._faults.late,
        )  # fmt: skip
        return self._last

    @property
    def walls(self) -> NDArray[np.float32]:
        """(4, n) float32: the walls that laser odometry remembers, in its frame: points (m) and normals; maybe none."""
        return np.empty((4, 0), np.float32) if self._laser is None else self._laser.walls

    def _odometry(self, scan: Scan, told: Array | None, recorded: Array | None) -> Array | None:
        """The odometry of a scan: as it was recorded, or with the faults of its steps mended, in one frame.

        A step that the wheels do not tell is the laser's: so the frame holds for whoever keeps things in it.
        """
        if not self._wheels:
            return None
        self._recorded = scan.odometry
        if self._last is None or self._last.odometry is None:
            return scan.odometry
        if told is None:
            self._unheard += 1
        self._mended |= told is None or told is not recorded
        return compose(self._last.odometry, self._step if told is None else told) if self._mended else scan.odometry

    def _at_the_stamp(self, scan: Scan, guess: Array) -> NDArray[np.float32]:
        """The scan as it is seen from where the robot was at its stamp, where the wheels tell how it went on.

        Without them only the steps before would tell, which was measured not to help (docs/motion.md).
        """
        laser = self._laser
        if (
            "deskewing" in self._without
            or self._deskewer.duration == 0.0
            or not self._wheels
            or scan.sweep is None
            or laser is None
        ):
            return scan.ranges
        return self._deskewer(scan.ranges, scan.sweep, lambda ranges: laser.fit(ranges, guess))

    def _guesses(self, last: Motion | None, told: Array | None, turn: float | None, seconds: float) -> list[Array]:
        """Steps that the robot may have made since the scan before, the most trusted first; ``told``: by the wheels."""
        if last is None:
            return [np.zeros(3)]
        # As before: for as long as it lasts, or not at all.
        going_on = self._step * (min(seconds / self._seconds, 3.0) if self._seconds > 0.0 else 0.0)
        guesses = [going_on, np.zeros(3)]
        if told is not None:
            guesses = [told, *guesses, told * [-1.0, -1.0, 1.0]]
        if turn is not None and last.turn is not None and math.isfinite(turn - last.turn):
            guesses.insert(1, np.array([*guesses[0][:2], turn - last.turn]))
        return guesses
