"""Off the map: poses from which the map knows nothing of the floor that the robot stands on.

A robot may drive on where the map ends. There the laser still sees walls that are mapped, through land of which nobody
knows anything; and of that land every reading is as likely as this laser's readings are on average. Wherever that
was allowed, beliefs fled into the unknown cells behind the walls: so it is entered from known floor only, not through a
wall, and for a price.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels import world
from pipeline.world.agnostic import Agnostic
from pipeline.world.expected_ranges import ExpectedRanges
from pipeline.world.rays import Rays
from pipeline.world.seen import FREE, UNKNOWN, WALL
from pipeline.world.world import CLEAR, World

PRICE = 3.0
"""Nats for driving from known floor into unknown land."""
WRONG = 0.3
"""Probability that a beam is worth no more than average though it comes to known land: maps end in what was seen once,
from afar, and a robot off the map should not be turned by it. With 0 two of six drives off a map went astray."""


@dataclass(frozen=True)
class OffMap:
    """Which of some poses are off the map, ``which`` (m,), and from where their lasers look: ``cells`` (m,) of the
    world, -1 off it, ``turns`` (m,) the headings of their first beams."""

    which: NDArray[np.int64]
    cells: NDArray[np.int64]
    turns: NDArray[np.int32]


class Unknown:
    """Scores poses on land that the map does not know. ``agnostic``: what the log's readings are worth on average."""

    def __init__(self, known: World, expected: ExpectedRanges, agnostic: Agnostic) -> None:
        self._world, self._expected, self._agnostic = known, expected, agnostic
        self._open_land = known.mapped == UNKNOWN
        # Where a wall's thickness is no more than that of its drawing, a laser sees what it sees before it.
        by_map = expected.place[-1]
        m = known.margin
        self._open_land[m : m + by_map.shape[0], m : m + by_map.shape[1]] &= by_map < 0
        self._far = np.where(np.arange(256) < 255, expected.codes.ranges, np.inf)

    def find(self, poses: NDArray[np.float32]) -> OffMap | None:
        """Those of the poses (3, n) of the grid frame that are off the map, None if none is."""
        which, cells, turns = self._off(poses)
        return OffMap(which, cells, turns) if len(which) else None

    def entered(
        self, off: OffMap, before: NDArray[np.float32], poses: NDArray[np.float32]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Of the poses that are off the map: whether each was not, ``before`` (3, n), and if it came through a wall."""
        came = np.ascontiguousarray(before[:, off.which])
        already = np.zeros(len(off.which), np.bool_)
        already[self._off(came)[0]] = True
        walled = np.empty(len(off.which), np.bool_)
        inv_resolution = self._expected.place[3]
        world.walled(
            off.which, *before[:2], *poses[:2], inv_resolution, self._world.margin, self._world.kinds, WALL, walled
        )
        return ~already, walled

    def beams(
        self, off: OffMap, ranges: NDArray[np.float32], agnostic: NDArray[np.float64], likelihood: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """(m, k) log-likelihood of the beams of a scan: ``ranges`` (k,) m, ``agnostic`` (k,) what each is worth if
        nobody knows what it should be, ``likelihood`` (k, 256) for each code of a true range."""
        survival = np.where(np.isfinite(self._far), self._agnostic.survival(self._far), 0.0)
        ended = ~(ranges[:, None] >= self._far)
        ended |= np.isinf(self._far)
        unknown = (1.0 - WRONG) * np.where(ended, agnostic[:, None], 0.0) + WRONG * agnostic[:, None]
        survival *= 1.0 - WRONG
        out = np.empty((len(off.which), len(ranges)), np.float32)
        walls, known = self._world.walls, self._world.known
        world.score(
            walls.rows(off.cells), known.rows(off.cells), off.turns, self._expected.offsets, walls.codes, known.codes,
            likelihood, unknown.astype(np.float32), survival.astype(np.float32), out,
        )  # fmt: skip
        return out

    def by_log(self, poses: NDArray[np.float32]) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
        """Of poses (3, n) those on floor near to where the log has shown anything, (m,), and the (m, k) codes of the
        ranges that their beams have in the world as it was shown."""
        near = np.zeros(self._open_land.shape, np.bool_)
        reach = math.ceil(CLEAR / self._world.resolution)
        near[tuple(slice(max(side.start - reach, 0), side.stop + reach) for side in self._world.box)] = True
        which, cells, turns = self._within(near, poses)
        on = (cells >= 0) & (self._world.kinds.reshape(-1)[np.maximum(cells, 0)] == FREE)
        return which[on], self._codes(self._world.first, cells[on], turns[on])

    def ranges(self, off: OffMap) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(m, k) each, m: how far each beam's first wall is, and the first cell that is known."""
        walls, known = (self._codes(rays, off.cells, off.turns) for rays in (self._world.walls, self._world.known))
        return self._far[walls], self._far[known]

    def _codes(self, rays: Rays, cells: NDArray[np.int64], turns: NDArray[np.int32]) -> NDArray[np.uint8]:
        rows = rays.rows(cells)
        return rays.codes[rows[:, None], turns[:, None] + self._expected.offsets]

    def _off(self, poses: NDArray[np.float32]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int32]]:
        return self._within(self._open_land, poses)

    def _within(
        self, wanted: NDArray[np.bool_], poses: NDArray[np.float32]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int32]]:
        """Of poses whose lasers are in ``wanted`` cells, or off the world: which, their lasers' cells and headings."""
        n = poses.shape[1]
        which, cells, turns = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int32)
        x, y, turn, inv_resolution, headings, _ = self._expected.place
        m = world.find(*poses, x, y, turn, inv_resolution, headings, self._world.margin, wanted, which, cells, turns)
        return which[:m], cells[:m], turns[:m]
