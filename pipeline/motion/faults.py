"""Faults of the wheels, passing or lasting: what laser odometry shows to be wrong with them, and what can be mended.

All is learnt from what has been seen up to now: a lasting fault is named as soon as enough of the drive shows it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.geometry import between, compose, wrap_angle
from pipeline.logs.leaps import leapt
from pipeline.logs.odometry import gone_on
from pipeline.motion.words import in_words

Array = NDArray[np.float64]
Kind = Literal["dead", "mirrored", "no_reverse", "scale", "late", "slipped", "restarted", "turned"]
KINDS: tuple[Kind, ...] = get_args(Kind)

CHUNK = 1.0
"""s: steps are added up for so long before they are compared: short enough to be all forwards or all backwards, long
enough that a step's noise, and wheels that come a little late, do not count."""
MEMORY_D, MEMORY_A = 15.0, 6.0
"""m, rad: of the drive behind, and of the turns in it, which are remembered (to 1/e)."""
DEAD_D, DEAD_A = 1.5, 1.5
"""m, rad: wheels are dead which have said nothing of so long a way, or so much turning."""
STILL_D, STILL_A = 0.002, 0.002
"""m, rad: a step of wheels that stand still."""
ENOUGH_A, ENOUGH_BACK, ENOUGH_D = 2.0, 0.8, 4.0
"""rad, m, m: turning, backing up, and driving forwards from which on a lasting fault can be told."""
BACKING = 0.1
"""m: a chunk in which the laser sees the robot back up by more is one of backing up."""
WRONG_WAY = 0.7
"""Share of the backing up that is told as forwards, from which on the wheels know no reverse. Wheels that do: 0."""
SCALE = 0.12
"""By how much the wheels' metres must be off to be called wrong. In nine buildings they were within 4 %."""
ENOUGH_TURNED, TURNED = 1.0, 0.5
"""m^2, rad: steps told times steps seen, added up; and the angle between them from which on the mount is wrong."""
STEADY = 0.97
"""Correlation of told and seen forward metres from which on their ratio is one: in eight of nine logs 0.995 or more."""
SLIP_D, SLIP_A, SLIP_SHARE = 0.3, math.radians(20.0), 0.25
"""m, rad, share of the step: by how much wheels and laser must differ in one step, for the wheels to have slipped. In
nine buildings the farthest apart were 0.27 m and 16 degrees."""
ODD_D, SPUN_D, KNOWN_D = 0.35, 0.6, 2.0
"""m: by how much they must differ in a CHUNK that teaches nothing of the wheels' metres, and in two that follow each
other, for the wheels to have slipped; and the drive from which on it is known what the wheels say of a metre. In eight
buildings a chunk was off by 0.19 m at most; wheels that are 0.3 s late are off by 0.3 s of the drive, never more."""
NEAR_ZERO = 0.5
"""m, rad: a counter that is restarted begins so close to zero."""
LATE, LATEST, LAG_STEP = 0.18, 0.6, 0.05
"""s: lags of the wheels' clock that are named, and looked for. In nine logs the largest were 0.15 s."""
LAG_WINDOW, LAG_EVERY = 30.0, 5.0
"""s: how far back turns are compared to tell a lag, and how often."""


@dataclass(frozen=True)
class Fault:
    """One fault of the wheels: ``kind``, and a sentence about it with numbers."""

    kind: Kind
    text: str


@dataclass(frozen=True)
class Step:
    """The step from one scan to the next at ``time`` (s), so many ``seconds`` long, as the wheels ``told`` it, and as
    the laser has ``seen`` it, None where it cannot say: (3,) m, m, rad."""

    time: float
    seconds: float
    told: Array
    seen: Array | None


class Faults:
    """Compares wheels and laser as the log is read.

    ``dead``: the wheels say nothing; ``late``: s, by which they are behind the laser, 0 unless it is a fault.
    """

    def __init__(self) -> None:
        self.dead = False
        self.late = 0.0
        self._mirrored = self._reverses = self._spinning = self._odd = False
        self._apart = 0.0
        self._scale = 1.0
        self._silent_way, self._held = np.zeros(3), list[Fault]()
        self._told = self._seen = np.zeros(3)
        self._seconds = 0.0
        self._turns, self._ways, self._back, self._aside = np.zeros(4), np.zeros(4), np.zeros(2), np.zeros(3)
        self._turned = False
        self._lags = _Lag()

    def update(self, step: Step) -> list[Fault]:
        """Learn from one more step; returns the faults that it shows for the first time."""
        slips = self._slip(step)
        named = [*slips, *self._death(step)]
        if step.seen is None or slips:
            self._begin_chunk()
            self._lags.clear()
            return named
        self._told, self._seen = compose(self._told, step.told), compose(self._seen, step.seen)
        self._seconds += step.seconds
        if self._seconds >= CHUNK:
            spun = self._spin(step.time)
            if not self._odd:
                self._learn(self._told, self._seen)
            self._begin_chunk()
            for lasting in (self._mirror, self._reverse, self._metres, self._mount):
                spun += lasting(step.time)
            named += spun
        if (lag := self._lags.update(step)) is not None:
            named += self._delay(step.time, *lag)
        return named

    def mended(self, told: Array) -> Array:
        """A step (3,) of the wheels as it must be read, by what is known of their lasting faults."""
        if self._mirrored:
            told = told * [1.0, -1.0, -1.0]
        return told if self._scale == 1.0 else np.array([told[0] / self._scale, told[1] / self._scale, told[2]])

    @property
    def _mounted_backwards(self) -> bool:
        """Whether the laser has not yet seen, when the wheels said forwards, that the robot drove forwards."""
        slope, _, driven = _regression(self._ways)
        return driven < ENOUGH_BACK or slope < 0.5

    def _begin_chunk(self) -> None:
        self._told = self._seen = np.zeros(3)
        self._seconds = 0.0

    def _learn(self, told: Array, seen: Array) -> None:
        drive, turn = abs(seen[0]), abs(seen[2])
        # As complex numbers: the way that is seen, from the way that is told.
        aside = complex(told[0], -told[1]) * complex(seen[0], seen[1])
        self._aside = self._aside * math.exp(-drive / MEMORY_D) + [aside.real, aside.imag, abs(aside)]
        self._turns = self._turns * math.exp(-turn / MEMORY_A) + _products(told[2], seen[2])
        if seen[0] > 0.0:
            self._ways = self._ways * math.exp(-drive / MEMORY_D) + _products(told[0], seen[0])
        elif seen[0] < -BACKING:
            forwards = told[0] > 0.25 * drive
            self._back = self._back * math.exp(-drive / MEMORY_D) + [drive, drive * forwards]

    def _slip(self, step: Step) -> list[Fault]:
        if step.seen is None or self.dead or self.late or self._turned:
            return []
        told = self.mended(step.told)
        apart, turned = math.hypot(*(told - step.seen)[:2]), abs(float(wrap_angle(told[2] - step.seen[2])))
        far = math.hypot(*step.seen[:2])
        if apart < SLIP_D + SLIP_SHARE * far and turned < SLIP_A + SLIP_SHARE * abs(step.seen[2]):
            return []
        # What is told the other way round is no slip: if it lasts, the wheels are mirrored, or know no reverse.
        if math.hypot(*(told * [-1.0, 1.0, 1.0] - step.seen)[:2]) < SLIP_D and turned < SLIP_A:
            return []
        if abs(float(wrap_angle(-told[2] - step.seen[2]))) < SLIP_A and apart < SLIP_D + SLIP_SHARE * far:
            return []
        text = f"The wheels slipped at {step.time:.1f} s: they say {in_words(told)}, the laser {in_words(step.seen)}."
        return [Fault("slipped", text)]

    def _spin(self, time: float) -> list[Fault]:
        """Two seconds in which the wheels turned more, or less, than they do for such a way."""
        told, seen = self._told, self._seen
        slope, _, driven = _regression(self._ways)
        apart = told[0] - (slope if driven > KNOWN_D else 1.0) * seen[0]
        self._odd = abs(apart) > ODD_D and seen[0] > -BACKING
        both, self._apart = self._apart + apart, apart
        was, self._spinning = self._spinning, abs(both) > SPUN_D and seen[0] > -BACKING
        if was or not self._spinning or self.dead or self.late or self._reverses or self._turned or driven < KNOWN_D:
            return []
        says = f"they say {in_words(told)} in the last of them, the laser {in_words(seen)}"
        slip = Fault("slipped", f"The wheels slipped in the two seconds before {time:.1f} s: {says}.")
        if self._silent_way.any():
            # Of wheels that stand still it is told when they turn again: until then they may be dead.
            self._held = [slip]
            return []
        return [slip]

    def _death(self, step: Step) -> list[Fault]:
        if math.hypot(*step.told[:2]) > STILL_D or abs(step.told[2]) > STILL_A:
            held, self._held = self._held, []
            self._silent_way, self.dead = np.zeros(3), False
            return held
        if step.seen is None:
            return []
        # Added up as poses: a laser that trembles goes nowhere.
        way = self._silent_way = compose(self._silent_way, step.seen)
        if self.dead or (math.hypot(*way[:2]) < DEAD_D and abs(way[2]) < DEAD_A):
            return []
        self.dead, self._held = True, []
        text = f"The wheels are dead at {step.time:.1f} s: they stand still, the laser says {in_words(way, 1)}."
        return [Fault("dead", text)]

    def _mirror(self, time: float) -> list[Fault]:
        slope, correlation, enough = _regression(self._turns)
        if enough < ENOUGH_A:
            return []
        was, self._mirrored = self._mirrored, slope < -0.5 and correlation < -0.8
        if was or not self._mirrored:
            return []
        text = (
            f"The wheels' turns are mirrored: what they call left is right. Found at {time:.1f} s, and corrected since."
        )
        return [Fault("mirrored", text)]

    def _mount(self, time: float) -> list[Fault]:
        along, across, amount = self._aside.tolist()
        angle, steady = math.atan2(across, along), math.hypot(along, across) > STEADY * amount
        was = self._turned
        self._turned = amount > ENOUGH_TURNED and (
            (steady and abs(angle) > TURNED) or (was and abs(angle) > 0.5 * TURNED)
        )
        if was or not self._turned:
            return []
        aside = f"{abs(math.degrees(angle)):.0f} deg {'left' if angle > 0.0 else 'right'}"
        text = (
            f"The laser sees the robot drive {aside} of where the wheels say. Found at {time:.1f} s. "
            "Is the laser mounted otherwise than the log says?"
        )
        return [Fault("turned", text)]

    def _reverse(self, time: float) -> list[Fault]:
        metres, forwards = self._back
        plain = (
            metres >= ENOUGH_BACK and forwards > WRONG_WAY * metres and not (self._turned or self._mounted_backwards)
        )
        was, self._reverses = self._reverses, bool(plain)
        if was or not self._reverses:
            return []
        text = (
            f"The wheels know no reverse: of {metres:.1f} m backwards they call {forwards:.1f} m forwards. "
            f"Found at {time:.1f} s."
        )
        return [Fault("no_reverse", text)]

    def _metres(self, time: float) -> list[Fault]:
        slope, correlation, enough = _regression(self._ways)
        if enough < ENOUGH_D or correlation < STEADY or abs(math.atan2(self._aside[1], self._aside[0])) > 0.5 * TURNED:
            return []
        was = self._scale
        wrong = abs(slope - 1.0) > (SCALE if was == 1.0 else 0.5 * SCALE)
        self._scale = slope if wrong else 1.0
        if was != 1.0 or not wrong:
            return []
        text = f"The wheels say {slope:.2f} m for every metre. Found at {time:.1f} s, and corrected from then on."
        return [Fault("scale", text)]

    def _delay(self, time: float, lag: float, deviation: float) -> list[Fault]:
        was = self.late
        self.late = lag if abs(lag) - 2.0 * deviation > (0.5 * LATE if was else LATE) else 0.0
        if was or not self.late:
            return []
        way = "behind" if lag > 0.0 else "ahead of"
        text = f"The wheels are {abs(lag):.2f} +- {2.0 * deviation:.2f} s {way} the laser. Found at {time:.1f} s."
        return [Fault("late", text)]


class _Lag:
    """By how much the wheels' turns come later than the laser's: least squares over the last LAG_WINDOW seconds."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, float, float]] = deque()
        self._next = 0.0

    def clear(self) -> None:
        self._rows.clear()

    def update(self, step: Step) -> tuple[float, float] | None:
        """Take in a step; every LAG_EVERY seconds the lag and its deviation (s), if there was turning enough."""
        rows = self._rows
        assert step.seen is not None
        if not rows:
            rows.append((step.time - step.seconds, 0.0, 0.0))
        _, told, seen = rows[-1]
        rows.append((step.time, told + step.told[2], seen + step.seen[2]))
        while rows[0][0] < step.time - LAG_WINDOW:
            rows.popleft()
        if step.time < self._next or step.time - rows[0][0] < 0.5 * LAG_WINDOW or step.seconds > LATEST:
            return None
        self._next = step.time + LAG_EVERY
        times, told_turn, seen_turn = np.array(rows).T
        if np.abs(np.diff(seen_turn)).sum() < ENOUGH_A:
            return None
        lags = np.arange(-LATEST, LATEST + 0.5 * LAG_STEP, LAG_STEP)
        inside = (times[1:] < times[-1] - LATEST) & (times[:-1] > times[0] + LATEST)
        steps = np.diff(told_turn)[inside]
        shifted = [np.diff(np.interp(times - lag, times, seen_turn))[inside] for lag in lags]
        misfit = np.square(steps - np.array(shifted)).sum(axis=1)
        best = int(np.argmin(misfit))
        # Mirrored or dead wheels fit at no lag.
        if not 0 < best < len(lags) - 1 or misfit[best] > 0.3 * np.square(steps).sum():
            return None
        before, at, after = misfit[best - 1 : best + 2]
        bend = before - 2.0 * at + after
        lag = lags[best] + 0.5 * LAG_STEP * (before - after) / bend
        return float(lag), float(LAG_STEP * math.sqrt(2.0 * at / len(steps) / bend))


def leap(time: float, step: Array, at: Array) -> Fault:
    """The fault of an odometry that has leapt by ``step`` (3,) m, m, rad, to the pose ``at`` (3,) in its own frame."""
    again = math.hypot(*at[:2]) < NEAR_ZERO and abs(at[2]) < NEAR_ZERO
    what = "It was restarted from zero" if again else "It slipped, or is wrong there"
    text = (
        f"The odometry leapt at {time:.1f} s: {in_words(step, 1)}, which no robot does. {what}. This step is left out, "
        "and it goes on from where it stood."
    )
    return Fault("restarted" if again else "slipped", text)


def without_leaps(times: Array, odometry: Array) -> Array:
    """Odometry (n, 3) at ``times`` (n,) s that goes on from where it stood at every leap; the same array without any.

    For those who ask the wheels alone: a filter's ``Witnesses`` leave the same steps out one by one.
    """
    leaps = np.flatnonzero(leapt(between(odometry[:-1], odometry[1:]), np.diff(times))) + 1
    return gone_on(odometry, leaps.tolist()) if len(leaps) else odometry


def _products(told: float, seen: float) -> Array:
    return np.array([told * seen, seen * seen, told * told, abs(seen)])


def _regression(sums: Array) -> tuple[float, float, float]:
    """Slope and correlation of what the wheels told over what was seen, through zero; and how much was seen."""
    both, seen, told, amount = sums.tolist()
    return both / max(seen, 1e-12), both / math.sqrt(max(seen * told, 1e-24)), amount
