"""The world as far as it is known: the map that was given, and over it what the log has shown to be otherwise."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels import world
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.maps.range_table import RangeCodes
from pipeline.world.rays import Rays

FREE, WALL, UNKNOWN = 0, 1, 2
MARGIN = 20.0
"""m: so far around the map land is thought of, as unknown; beyond it nothing that is known can be seen."""
CLEAR = 8.0
"""m: farther away, beams a degree apart pass by the ends of thin walls; what they pass is not counted, nor what they
hit."""
SEEN_HITS, SEEN_WALL = 2.0, 0.4
"""Scans that must have ended in a cell, and their least share among all that came to it, so that it is a wall."""
SEEN_PASSES, SEEN_FREE = 3.0, 0.1
"""Scans that must have passed a cell, and the most of them that may have ended there, so that it is free."""
MOST = 20.0
"""Scans that are remembered of a cell: a door that was open is shut once some ten scans have seen it so."""
SAME = 0.3
"""m: a wall that is so close to a mapped one is that: maps are drawn no better, nor is the place known better."""


class World:
    """Rasters of FREE, WALL and UNKNOWN cells, the map's with MARGIN around it (``margin``, in cells).

    ``mapped`` (height, width) uint8: as the map has it; ``kinds``: with what the log has shown. What scans say is
    counted by ``look``; it speaks from the next ``renew`` on.
    """

    def __init__(self, grid: OccupancyGrid, threshold: float, scale: RangeCodes, width: int) -> None:
        self._grid, self._scale, self._width = grid, scale, width
        self.margin = math.ceil(MARGIN / grid.resolution)
        mapped = np.where(grid.known, grid.occupied(threshold), UNKNOWN).astype(np.uint8)
        self.mapped = np.pad(np.ascontiguousarray(mapped), self.margin, constant_values=UNKNOWN)
        self.kinds = self.mapped
        self.changed = False
        self._scans = 0
        self.forget()
        self._cast()

    def forget(self) -> None:
        """Count anew."""
        self._passes, self._hits = np.zeros(self.mapped.size, np.float32), np.zeros(self.mapped.size, np.float32)
        self._passed_at, self._hit_at = np.zeros(self.mapped.size, np.int32), np.zeros(self.mapped.size, np.int32)

    def look(self, laser: NDArray[np.float64], angles: NDArray[np.float64], ranges: NDArray[np.float32]) -> None:
        """Count what a scan saw from a pose (3,) of the laser, grid frame: ``angles`` (k,) rad, ``ranges`` (k,) m, inf
        where nothing came back, NaN where nothing is known."""
        self._scans += 1
        cell = self._grid.resolution
        height, width = self.mapped.shape
        world.look(
            laser[0] / cell, laser[1] / cell, laser[2], angles, ranges / np.float32(cell), CLEAR / cell, width,
            self.margin, self._scans, self._passed_at, self._hit_at, self._passes, self._hits, np.float32(MOST),
        )  # fmt: skip

    def renew(self) -> None:
        """Let what was counted speak."""
        total = self._hits + self._passes
        wall = (self._hits >= SEEN_HITS) & (self._hits > SEEN_WALL * total)
        free = (self._passes >= SEEN_PASSES) & (self._hits < SEEN_FREE * total)
        wall, free = wall.reshape(self.mapped.shape), free.reshape(self.mapped.shape)
        kinds = self.mapped.copy()
        kinds[free] = FREE
        kinds[wall] = WALL
        if not np.array_equal(kinds, self.kinds):
            self.kinds, self.changed = kinds, True
            self._cast()

    def _cast(self) -> None:
        walls, known = (self.kinds == WALL).astype(np.uint8), (self.kinds != UNKNOWN).astype(np.uint8)
        cast = self._scale, self._grid.resolution, self._width
        # To the first wall, through whatever is unknown; to the first cell that is known; and to whatever comes first.
        self.walls, self.known, self.first = Rays(walls, *cast), Rays(known, *cast), Rays(self.kinds, *cast)
