"""Tells when wheels and laser contradicted each other for a while, and whom the belief followed."""

from __future__ import annotations

import math

import numpy as np

from pipeline.filter.step import Event, Step
from pipeline.geometry import between, wrap_angle
from pipeline.motion.prior import AGREE
from pipeline.motion.witnesses import Motion
from pipeline.motion.words import in_words

LONG, LAPSE = 1.0, 0.5
"""s: shorter contradictions are not told; agreement for less than the second does not end one."""
FAR, FAR_TURN = 0.5, math.radians(20.0)
"""m, rad: nor are those over which the witnesses came to be less than this apart."""


class Contradiction:
    """Follows the steps of a run in their order."""

    def __init__(self) -> None:
        self._before: Motion | None = None
        self._begun: Motion | None = None
        self._last: Motion | None = None
        self._followed: list[float] = []

    def hear(self, step: Step) -> list[Event]:
        """The sentence about a contradiction that is over by this step, if it is worth one."""
        events = []
        motion = step.motion
        if self._last is not None and (step.time - self._last.time > LAPSE or _parted(self._last, motion)):
            events = self._told()
            self._begun = self._last = None
            self._followed = []
        if step.prior is None or step.followed is None:
            self._before = motion if step.moved else self._before
            return events
        if step.prior.disagreement > AGREE and self._before is not None:
            self._begun = self._begun or self._before
            self._last = motion
            names = [component.name for component in step.prior.components]
            self._followed.append(float(step.followed[names.index("laser")]))
        self._before = motion
        return events

    def _told(self) -> list[Event]:
        a, b = self._begun, self._last
        assert a is not None
        assert b is not None
        if b.time - a.time < LONG or a.odometry is None or b.odometry is None:
            return []
        wheels, laser = between(a.odometry, b.odometry), between(a.pose, b.pose)
        apart = math.hypot(*(wheels - laser)[:2])
        if apart < FAR and abs(float(wrap_angle(wheels[2] - laser[2]))) < FAR_TURN:
            return []
        share = float(np.mean(self._followed))
        who, share = ("laser", share) if share >= 0.5 else ("wheels", 1.0 - share)
        said = f"the wheels say {in_words(wheels, 1)}, the laser {in_words(laser, 1)}"
        text = f"From {a.time:.1f} to {b.time:.1f} s {said}; {100 * share:.0f} % of the belief follows the {who}."
        return [Event("contradicted", text)]


def _parted(a: Motion, b: Motion) -> bool:
    """No match leads from one to the other."""
    return a.laser is None or b.laser is None or a.laser.stretch != b.laser.stretch
