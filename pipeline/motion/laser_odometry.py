"""Laser odometry: how the robot moved, told by its laser alone (PLICP, Censi 2008; local map as in kiss-icp, 2023)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.geometry import between, compose
from pipeline.kernels import matching
from pipeline.kernels.surfaces import surfaces
from pipeline.logs.leaps import FASTEST, SPINNING
from pipeline.logs.messages import Laser

Array = NDArray[np.float64]

LONGEST = 30.0
"""m: farther readings are too few and too far apart to tell how a wall runs."""
WINDOW, THICKNESS, SPACING = 0.2, 0.03, 0.05
"""m: a wall's direction is that of the readings within the first; they lie on one line to within the second (RMS);
points are kept the third apart."""
SCALE = 0.05
"""m: how far from its line a reading counts as off it."""
REACH = 0.5
"""m: a reading farther than this from every remembered wall finds none. What is farther off, a window has to find."""
CELL, CELLS = 0.1, 512
"""m, and their number along a side: the grid that tells the nearest remembered point. Farther walls wrap around it."""
POINTS = 150
"""Points of a scan that are matched, at most; key scans keep twice as many."""
PATIENCE, MOMENT = 3, 1.0
"""Scans for which a scan that fits nothing may be somebody who stands in the way, where scans follow each other within
the moment, s, and the wheels say how the robot goes on."""
KEYS, FRESH = 24, 16
"""Key scans that are remembered; when there are more, only the latest FRESH stay."""
KEY_D, KEY_A = 0.25, 0.2
"""m, rad: a scan farther than this from the last key scan becomes one."""
FEWEST = 15
"""Points without which a scan says nothing."""
POOR = 0.6
"""Fit below which a wide window is searched: right matches fit by 0.65 or more (1st percentile, docs/motion.md)."""
GOOD = 0.85
"""Fit below which the covariance grows: with the fourth power of how far."""
BROKEN, BROKEN_ALONE = 0.4, 0.3
"""Fit below which no match holds, and the memory of walls begins anew: where the wheels tell how to go on, and where
nobody does, so that a poor match is better than none."""
PRICE, CLEARLY = 1.5, 0.25
"""Points, and fit, by which a match must be better that is elsewhere than the first guess leads: somebody walking by is
some points, and of a wide window's many places one always fits by chance."""
ELSEWHERE_D, ELSEWHERE_A = 0.03, 0.03
"""m, rad: two matches closer than this are one."""
USUAL = 0.02
"""Share of a new interval in the usual one: stamps that are written in a burst are closer than the scans were."""
SIGMA = 0.02
"""m: deviation of a point from its line, from which the covariance follows. Larger than a laser's own noise, since
neighbours err together: in three real buildings NEES is about 1, in made-up ones 0.2 to 0.6 (docs/motion.md)."""
OPEN, OPEN_POINTS = 0.01, 4.0
"""A direction in which the points' normals have less than this share of their squares is open: a corridor's length.
Where wheels tell of it, also with less than so many points: they may be somebody's legs. Without wheels they are all
that there is."""
ANYWHERE = 1e3
"""m^2 or rad^2: variance in an open direction."""


@dataclass(frozen=True)
class Match:
    """What one scan says of where the robot is, in the frame of laser odometry, which starts at the first scan.

    ``pose`` (3,) m, m, rad; ``covariance`` (3, 3) of the pose against the remembered walls, without the drift of these,
    zero at the first pose of a stretch, which says where its walls are;
    ``fit``: how well the scan fits there, in [0, 1]; ``fit_as_told``: at the first guess, which is the wheels' if there
    are wheels; ``open``: unit vector (2,) of a direction that the walls leave open, None if there is none; ``wide``:
    found in a wide window only; ``stretch``: counts the breaks. Poses of two stretches say nothing about each other.
    ``blind``: it broke for want of walls, in this scan or in the memory, or is joined again after a scan that fitted
    nothing; that it sees other walls is not said.
    """

    pose: Array
    covariance: Array
    fit: float
    fit_as_told: float
    open: Array | None
    wide: bool
    stretch: int
    blind: bool = False


@dataclass(frozen=True)
class Window:
    """Where a match is looked for when no guess leads to one: ``half_width`` m and ``half_angle`` rad around."""

    half_width: float
    half_angle: float

    @classmethod
    def after(cls, seconds: float) -> Window:
        """As far as a robot may be off a guess after so many seconds, within what can be searched."""
        width, angle = min(1.6 if seconds < SECOND else 4.0, FASTEST * seconds + 0.1), SPINNING * seconds + 0.2
        return cls(width, min(angle, math.radians(100.0) if seconds < SECOND else math.pi))


class LaserOdometry:
    """Matches every scan to the walls that the latest key scans saw."""

    def __init__(self, laser: Laser, max_range: float | None = None) -> None:
        x, y, yaw = laser.pose
        angles = laser.angles + yaw
        self._beams = (np.cos(angles), np.sin(angles), x, y, min(LONGEST, 0.98 * laser.longest(max_range)))
        self._surface = (abs(laser.angle_increment), WINDOW, THICKNESS, SPACING)
        self._seen = np.empty((4, laser.beams), np.float32)
        self._walls = _Walls(2 * POINTS)
        self._aside: _Walls | None = None
        self._doubtful = 0
        self._pose, self._stretch = np.zeros(3), 0
        self._usual = 0.0

    @property
    def walls(self) -> NDArray[np.float32]:
        """(4, n) float32: the points (m) of the remembered key scans and their normals."""
        return self._walls.points

    def update(self, ranges: NDArray[np.float32], guesses: Sequence[Array], seconds: float, told: bool = True) -> Match:
        """Match one scan (beams,) float32 m; ``guesses`` (3,) of the step since the last one, the most trusted first.

        If none of them leads to a good fit, a window around the first is searched, as wide as a robot drives in so many
        ``seconds``. ``told``: the first guess is somebody's word, the wheels', and not just how the robot moved before.
        """
        n, seen = self._points(ranges)
        self._usual += USUAL * (seconds - self._usual) if self._usual else seconds
        first = compose(self._pose, guesses[0])
        if self._walls.empty or seen.shape[1] < FEWEST:
            return self._lost(first, n, blind=True)
        least, wide = PRICE / seen.shape[1], False
        self._walls.least = OPEN_POINTS if told else 0.0
        best = self._walls.match(seen, first)
        for guess in guesses[1:]:
            other = self._walls.match(seen, compose(self._pose, guess))
            if other.fit > best.fit + least and _apart(best.pose, other.pose) and self._possible(other.pose, seconds):
                best = other
        if best.fit < POOR:
            least = CLEARLY if told else least
            for start in self._walls.search(seen, first, Window.after(seconds)):
                other = self._walls.match(seen, start)
                if other.fit > best.fit + (0.0 if wide else least) and self._possible(other.pose, seconds):
                    best, wide = other, True
        as_told = self._walls.fit(seen, first)
        if seconds > MOMENT:
            self._aside = None
        if self._aside is not None and (settled := self._settle(seen, n, first, best)) is not None:
            return settled
        if best.fit < (BROKEN if told else BROKEN_ALONE) or not self._possible(best.pose, seconds):
            if told and seconds < MOMENT and self._aside is None:
                self._aside, self._doubtful, self._walls = self._walls, 0, _Walls(2 * POINTS)
            return self._lost(first, n, blind=self._aside is not None)
        pose = _kept(best.pose, first, best.open)
        self._pose = pose
        self._walls.remember(self._seen[:, :n], pose)
        return Match(pose, best.covariance, best.fit, as_told, best.open, wide, self._stretch)

    def begin_anew(self, ranges: NDArray[np.float32]) -> None:
        """Forget the walls, but for what this scan (beams,) sees from where it was matched."""
        n, _ = self._points(ranges)
        self._aside = None
        self._walls.forget()
        self._walls.remember(self._seen[:, :n], self._pose)

    def _settle(self, seen: NDArray[np.float32], n: int, first: Array, best: _Fit) -> Match | None:
        """After a scan that fitted nothing: whether the walls from before it are back, so that somebody stood in the
        way, or the robot is among others now. None as long as that is open."""
        assert self._aside is not None
        self._walls, anew = self._aside, self._walls
        back = self._walls.match(seen, first)
        if back.fit > POOR and back.fit > best.fit - 0.1:
            self._aside = None
            self._pose, self._stretch = _kept(back.pose, first, back.open), self._stretch + 1
            self._walls.remember(self._seen[:, :n], self._pose)
            return Match(self._pose, back.covariance, back.fit, back.fit, back.open, False, self._stretch, blind=True)
        self._walls, self._doubtful = anew, self._doubtful + 1
        if best.fit < GOOD and self._doubtful < PATIENCE:
            return None
        self._aside = None
        return self._lost(first, n)

    def _possible(self, pose: Array, seconds: float) -> bool:
        """Whether a robot gets there in that time."""
        step, seconds = between(self._pose, pose), max(seconds, self._usual)
        return math.hypot(step[0], step[1]) < FASTEST * seconds + 0.1 and abs(step[2]) < SPINNING * seconds + 0.2

    def fit(self, ranges: NDArray[np.float32], guess: Array) -> float:
        """How well a scan (beams,) would fit, matched from one guess (3,) of the step; nothing is remembered of it."""
        _, seen = self._points(ranges)
        if self._walls.empty or seen.shape[1] < FEWEST:
            return 0.0
        return self._walls.match(seen, compose(self._pose, guess)).fit

    def _points(self, ranges: NDArray[np.float32]) -> tuple[int, NDArray[np.float32]]:
        """How many points of walls the scan has, which are in ``_seen``; and those of them that are matched."""
        n = surfaces(ranges, *self._beams, *self._surface, self._seen)
        return n, np.ascontiguousarray(self._seen[:, : n : max(1, -(-n // POINTS))])

    def _lost(self, told: Array, n: int, blind: bool = False) -> Match:
        """No match holds: go on from where the first guess leads, with no memory of what was before."""
        self._pose, self._stretch = told, self._stretch + 1
        self._walls.forget()
        if n >= FEWEST:
            self._walls.remember(self._seen[:, :n], told)
        # Where walls are remembered from here on, they are where this pose says: it cannot be wrong against them.
        return Match(told, np.zeros((3, 3)), 0.0, 0.0, None, False, self._stretch, blind)


@dataclass(frozen=True)
class _Fit:
    pose: Array
    fit: float
    covariance: Array
    open: Array | None


class _Walls:
    """The points of the latest key scans, and a grid that knows the nearest of them everywhere."""

    def __init__(self, each: int) -> None:
        self._each = each
        self._points = np.empty((4, (KEYS + 1) * each), np.float32)
        self._cells = np.full((CELLS, CELLS), -1, np.int32)
        self._sizes: list[int] = []
        self._key = np.zeros(3)
        self.least = OPEN_POINTS
        """Points without which a direction is open."""

    @property
    def empty(self) -> bool:
        return not self._sizes

    @property
    def points(self) -> NDArray[np.float32]:
        return self._points[:, : sum(self._sizes)]

    @property
    def _memory(self) -> tuple[NDArray[np.float32], NDArray[np.int32], float]:
        return self._points, self._cells, 1.0 / CELL

    def match(self, seen: NDArray[np.float32], guess: Array) -> _Fit:
        pose, normal = np.empty(3), np.empty((3, 3))
        fit = matching.align(seen, seen.shape[1], guess, *self._memory, REACH, SCALE, pose, normal)
        covariance, way = _covariance(normal, max(OPEN * seen.shape[1], self.least))
        # Where much does not fit, what seems to fit may be what moves.
        doubt = max(1.0, GOOD / max(fit, 0.1)) ** 4
        return _Fit(_kept(pose, guess, way), fit, doubt * covariance, way)

    def fit(self, seen: NDArray[np.float32], pose: Array) -> float:
        """At a pose that is not matched, and so as good as the wheels: with twice the scale."""
        return float(matching.fit(seen, seen.shape[1], pose, *self._memory, 2.0 * SCALE))

    def search(self, seen: NDArray[np.float32], centre: Array, window: Window) -> list[Array]:
        """The best places of a window, at most four headings apart from each other."""
        few = np.ascontiguousarray(seen[:, :: max(1, seen.shape[1] // 60)])
        headings = max(1, math.ceil(window.half_angle / WINDOW_TURN))
        poses, scores = np.empty((2 * headings + 1, 3)), np.empty(2 * headings + 1)
        step = window.half_angle / headings
        matching.sweep(
            few, few.shape[1], centre, window.half_width, WINDOW_STEP, window.half_angle, step, *self._memory,
            WINDOW_STEP, poses, scores,
        )  # fmt: skip
        best: list[int] = []
        for row in np.argsort(-scores, kind="stable").tolist():
            if all(abs(row - other) > 2 for other in best):
                best.append(row)
            if len(best) == CANDIDATES:
                break
        return [poses[row] for row in best]

    def remember(self, seen: NDArray[np.float32], pose: Array) -> None:
        """The scan becomes a key scan, if it is far enough from the last one."""
        away = between(self._key, pose)
        if self._sizes and math.hypot(away[0], away[1]) < KEY_D and abs(away[2]) < KEY_A:
            return
        new = seen[:, :: max(1, -(-seen.shape[1] // self._each))]
        if len(self._sizes) == KEYS:
            gone = sum(self._sizes[: KEYS - FRESH])
            kept = self._points[:, gone : sum(self._sizes)].copy()
            self._sizes = self._sizes[KEYS - FRESH :]
            self._points[:, : kept.shape[1]] = kept
            self._cells.fill(-1)
            matching.enter(self._points, 0, kept.shape[1], self._cells, 1.0 / CELL, REACH)
        first = sum(self._sizes)
        last = first + new.shape[1]
        matching.carry(new, pose, self._points[:, first:last])
        matching.enter(self._points, first, last, self._cells, 1.0 / CELL, REACH)
        self._sizes.append(new.shape[1])
        self._key = pose

    def forget(self) -> None:
        self._sizes.clear()
        self._cells.fill(-1)


WINDOW_STEP, WINDOW_TURN = 0.2, math.radians(4.0)
"""m, rad: steps of a search in a window; a match finds its way from there."""
CANDIDATES = 4
SECOND = 1.0
"""s: scans farther apart are looked for much farther around."""


def _kept(pose: Array, guess: Array, way: Array | None) -> Array:
    """A match which in the direction that it leaves open is where the guess was."""
    if way is None:
        return pose
    moved = pose.copy()
    moved[:2] += way * (way @ (guess - pose)[:2])
    return moved


def _apart(a: Array, b: Array) -> bool:
    """Whether two matches are two."""
    away = between(a, b)
    return math.hypot(away[0], away[1]) > ELSEWHERE_D or abs(away[2]) > ELSEWHERE_A


def _covariance(normal: Array, least: float) -> tuple[Array, Array | None]:
    """Of a match, from its normal equations (3, 3); and the direction which less than ``least`` points hold, if any."""
    turns = normal[2, 2] + 1e-6
    # What the points say of the place once the heading has had its share.
    place = normal[:2, :2] - np.outer(normal[:2, 2], normal[2, :2]) / turns
    strength, ways = np.linalg.eigh(place)
    if strength[0] >= least:
        return np.asarray(SIGMA**2 * np.linalg.inv(normal), np.float64), None
    held = normal + np.diag([0.0, 0.0, 1e-6])
    way = np.array([ways[0, 0], ways[1, 0], 0.0])
    # In the open direction the points' word is the noise of their normals: it is taken back.
    projection = np.eye(3) - np.outer(way, way)
    held = projection @ held @ projection + np.outer(way, way) * SIGMA**2 / ANYWHERE
    if strength[1] < least:
        return ANYWHERE * np.eye(3), way[:2]
    return np.asarray(SIGMA**2 * np.linalg.inv(held), np.float64), way[:2]
