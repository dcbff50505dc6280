"""What wheels and laser say of the way, and whom the belief follows, step by step, as plain arrays."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.filter.step import Step
from pipeline.geometry import between, compose, inverse, wrap_angle
from pipeline.logs.messages import Laser
from pipeline.motion.prior import AGREE, UNSEEN, UNSEEN_BY_WHEELS
from pipeline.recording import palette

Array = NDArray[np.float64]

WHILE = 1.0
"""s: contradictions are drawn over so long a way: between two scans a robot moves by less than its own radius."""
NOTICEABLE, NOTICEABLE_TURN = 0.1, np.deg2rad(5.0)
"""m, rad: witnesses that end closer together are not drawn apart."""
SURE_SPREAD, SURE_WEIGHT = 0.5, 0.95
"""m, and weight of the best hypothesis: from then on the estimate says how the robot moved."""
POINTS, APART, NEAR = 250, 0.15, 10.0
"""Remembered points that are recorded at most; m between them, and from the robot."""


@dataclass(frozen=True)
class Said:
    """A contradiction: from ``start`` (3,) in the map frame, where the estimate was a moment ago, to ``wheels`` and
    ``laser`` (3,), where either says that the robot is now; ``scan`` (k, 2) m: where the scan would be if the wheels
    were right; ``followed``: mean share of the weight that followed the laser when they contradicted each other."""

    start: Array
    wheels: Array
    laser: Array
    scan: Array
    followed: float


Poses = tuple[Array | None, Array, Array]
"""By the wheels, None without wheels; by the laser; and as believed."""


@dataclass(frozen=True)
class Heard:
    """Of one step: ``now``, poses (3,) in the odometry's frame, all from the same start, by the increments of each;
    ``before``: those of the step before.

    ``fits``: the share of the beams that fit the remembered walls where the laser says, and, with wheels, where they
    say; ``apart``: disagreement over its 99 % limit, as a deviation, MOST_APART at most; ``followed``: share of the
    weight that followed the laser, and the other. Both None where the robot did not move, ``apart`` also where one is
    silent.
    ``walls`` (k, 2): the points that were remembered before this scan, in the frame of the laser's odometry, None if
    as before; ``frame`` (3,): that frame, seen from the laser. ``said``: see there; None if there is no contradiction.
    """

    now: Poses
    before: Poses
    fits: tuple[float, ...]
    apart: float | None
    followed: tuple[float, float] | None
    won: str | None
    walls: Array | None
    frame: Array
    said: Said | None


@dataclass(frozen=True)
class _Past:
    step: Step
    contradicted: bool


class Hearing:
    """Listens to the steps of a run in their order."""

    def __init__(self, laser: Laser, *, wheels: bool) -> None:
        self._wheels, self._mount = wheels, np.array(laser.pose)
        self._last: tuple[Step, Poses] | None = None
        self._past: deque[_Past] = deque()
        self._walls: NDArray[np.float32] | None = None
        self._changed = False
        self._mark: tuple[int, bytes] = (0, b"")
        self._way = ""

    def hear(self, step: Step, joined: bool) -> Heard | None:
        """Take note of a step, which ``joined`` the estimate before without a jump; None if only wheels are heard."""
        match = step.motion.laser
        if match is None:
            return None
        now: Poses = (step.motion.odometry if self._wheels else None, step.motion.pose, self._believed(step, joined))
        before = now if self._last is None else self._last[1]
        walls = self._walls if self._changed else None
        self._remember(step)
        heard = Heard(
            now,
            before,
            fits=(match.fit, match.fit_as_told) if self._wheels else (match.fit,),
            apart=_apart(step),
            followed=_followed(step),
            won=self._won(step),
            walls=None if walls is None else walls.astype(np.float64),
            frame=inverse(compose(match.pose, self._mount)),
            said=self._said(step, joined),
        )
        self._last = (step, now)
        return heard

    def _won(self, step: Step) -> str | None:
        """How the robot moved, as most of the belief has it, if it is another way than before."""
        if step.prior is None or step.followed is None:
            return None
        gap = step.motion.unseen
        names = [component.name for component in step.prior.components]
        won = "carried?" if gap is not None and not gap.driven else _in_short(names[int(np.argmax(step.followed))])
        if won == self._way:
            return None
        self._way = won
        return won

    def _believed(self, step: Step, joined: bool) -> Array:
        """As far as the belief knows where it is; else as dead reckoning says."""
        if self._last is None:
            return step.motion.pose
        before, (_, _, at) = self._last
        if joined and _sure(before) and _sure(step):
            return compose(at, between(before.estimate.pose, step.estimate.pose))
        return compose(at, between(before.motion.pose, step.motion.pose))

    def _remember(self, step: Step) -> None:
        """Keeps some of the walls that the next scan will be matched to."""
        walls = np.empty((4, 0), np.float32) if step.walls is None else step.walls
        mark = (walls.shape[1], walls[:2, -1:].tobytes())
        self._changed = mark != self._mark
        if self._changed:
            assert step.motion.laser is not None
            self._mark, self._walls = mark, thinned(walls[:2].T, step.motion.laser.pose[:2])

    def _said(self, step: Step, joined: bool) -> Said | None:
        ratio = _apart(step)
        contradicted = ratio is not None and ratio > 1.0
        past = self._past
        if not joined:
            past.clear()
        while past and (past[0].step.time < step.time - WHILE - 1e-6 or _broken(past[0].step, step)):
            past.popleft()
        past.append(_Past(step, contradicted))
        if len(past) < 2 or step.motion.odometry is None:
            return None
        told = [p.step for p in list(past)[1:] if p.contradicted]
        first = past[0].step
        if not told or first.motion.odometry is None:
            return None
        by_wheels = between(first.motion.odometry, step.motion.odometry)
        by_laser = between(first.motion.pose, step.motion.pose)
        distance, turn = np.hypot(*(by_wheels - by_laser)[:2]), abs(wrap_angle(by_wheels[2] - by_laser[2]))
        if distance < NOTICEABLE and turn < NOTICEABLE_TURN:
            return None
        start = np.asarray(first.estimate.pose, np.float64)
        at = compose(start, by_wheels)
        shares = [shared[0] for s in told if (shared := _followed(s)) is not None]
        return Said(start, at, compose(start, by_laser), self._scan_at(step, at), float(np.mean(shares)))

    def _scan_at(self, step: Step, pose: Array) -> Array:
        beams = step.beams
        returned = np.isfinite(beams.measured)
        reach, angles = beams.measured[returned].astype(np.float64), beams.angles[returned]
        ends = np.column_stack([reach * np.cos(angles), reach * np.sin(angles), 0.0 * reach])
        return compose(compose(pose, self._mount), ends)[:, :2]


def thinned(points: NDArray[np.float32], centre: Array) -> NDArray[np.float32]:
    """At most POINTS of the points (n, 2), the nearest to ``centre`` (2,), one in each square of a fine grid."""
    apart = points - centre.astype(np.float32)
    distances = np.hypot(apart[:, 0], apart[:, 1])
    near = np.flatnonzero(distances < NEAR)
    squares = np.floor(points[near] / np.float32(APART)).astype(np.int64)
    kept = near[np.unique((squares[:, 0] << 32) + squares[:, 1], return_index=True)[1]]
    if len(kept) > POINTS:
        kept = kept[np.sort(np.argpartition(distances[kept], POINTS)[:POINTS])]
    return points[kept]


def _apart(step: Step) -> float | None:
    if step.prior is None or not np.isfinite(step.prior.disagreement):
        return None
    return min(float(np.sqrt(step.prior.disagreement / AGREE)), palette.MOST_APART)


def _followed(step: Step) -> tuple[float, float] | None:
    """How much of the weight followed the laser, and anything else."""
    if step.prior is None or step.followed is None:
        return None
    laser = sum(
        float(share)
        for component, share in zip(step.prior.components, step.followed, strict=True)
        if component.name == "laser"
    )
    return laser, 1.0 - laser


def _sure(step: Step) -> bool:
    return step.spread < SURE_SPREAD and step.estimate.weight > SURE_WEIGHT


def _broken(first: Step, now: Step) -> bool:
    """No match leads from one to the other."""
    assert first.motion.laser is not None
    assert now.motion.laser is not None
    return first.motion.laser.stretch != now.motion.laser.stretch


def _in_short(component: str) -> str:
    """The name of a component for a line of states: only who is believed, not with which noise."""
    if component == UNSEEN:
        return "nobody saw"
    if component == UNSEEN_BY_WHEELS:
        return "wheels, roughly"
    return component.partition(",")[0]
