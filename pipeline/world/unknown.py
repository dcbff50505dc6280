"""Off the map: poses from which the map knows nothing of the floor that the robot stands on.

A robot may drive on where the map ends. There the laser still sees walls that are mapped, through land of which nobody
knows anything; and of that land every reading is as likely as this laser's readings are on average. Wherever that
was allowed, beliefs fled into the unknown cells behind the walls: so it is entered from known floor only, not through a
wall, and for a price.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels import world
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.world.agnostic import Agnostic
from pipeline.world.expected_ranges import ExpectedRanges
from pipeline.world.rays import UNKNOWN, WALL, Rays

PRICE = 3.0
"""Nats for driving from known floor into unknown land."""
LEAST_KNOWN = 0.05
"""m: a beam that ends so close before the first known cell may have ended there."""


@dataclass(frozen=True)
class OffMap:
    """Which of some poses are off the map, ``which`` (m,), and what their lasers see there: ``rows`` (m,) of the rays,
    ``turns`` (m,) the headings of their first beams."""

    which: NDArray[np.int64]
    rows: NDArray[np.int64]
    turns: NDArray[np.int32]


class Unknown:
    """Scores poses that stand on unknown land. ``agnostic``: what the log's readings are worth on average."""

    def __init__(self, grid: OccupancyGrid, threshold: float, expected: ExpectedRanges, agnostic: Agnostic) -> None:
        self._rays = rays = Rays(grid, threshold, expected.codes, expected.rows.shape[1])
        self._expected, self._agnostic = expected, agnostic
        m = rays.margin
        open_land = rays.kinds == UNKNOWN
        # Where a wall's thickness is no more than that of its drawing, a laser sees what it sees before it.
        open_land[m : m + grid.height, m : m + grid.width] &= expected.place[-1] < 0
        self._open_land = open_land
        self._far = np.where(np.arange(256) < 255, expected.codes.ranges, np.inf)

    def find(self, poses: NDArray[np.float32]) -> OffMap | None:
        """Those of the poses (3, n) of the grid frame that are off the map, None if none is."""
        which, cells, turns = self._off(poses)
        return OffMap(which, self._rays.rows(cells), turns) if len(which) else None

    def entered(self, off: OffMap, before: NDArray[np.float32], poses: NDArray[np.float32]) -> tuple[
        NDArray[np.bool_], NDArray[np.bool_]
    ]:
        """Of the poses that are off the map: whether each was not, ``before`` (3, n), and if it came through a wall."""
        came = np.ascontiguousarray(before[:, off.which])
        already = np.zeros(len(off.which), np.bool_)
        already[self._off(came)[0]] = True
        walled = np.empty(len(off.which), np.bool_)
        inv_resolution = self._expected.place[3]
        world.walled(
            off.which, *before[:2], *poses[:2], inv_resolution, self._rays.margin, self._rays.kinds, WALL, walled
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
        unknown = np.where(ended, agnostic[:, None], 0.0)
        out = np.empty((len(off.which), len(ranges)), np.float32)
        rays = self._rays
        world.score(
            off.rows, off.turns, self._expected.offsets, rays.by_map, rays.known_from, likelihood,
            unknown.astype(np.float32), survival.astype(np.float32), out,
        )  # fmt: skip
        return out

    def ranges(self, off: OffMap) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(m, k) each, m: how far each beam's first mapped wall is, and the first cell that the map knows."""
        at = off.turns[:, None] + self._expected.offsets
        rows = off.rows[:, None]
        return self._far[self._rays.by_map[rows, at]], self._far[self._rays.known_from[rows, at]]

    def _off(self, poses: NDArray[np.float32]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int32]]:
        n = poses.shape[1]
        which, cells, turns = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int32)
        x, y, turn, inv_resolution, headings, _ = self._expected.place
        m = world.find(
            *poses, x, y, turn, inv_resolution, headings, self._rays.margin, self._open_land, which, cells, turns
        )
        return which[:m], cells[:m], turns[:m]
