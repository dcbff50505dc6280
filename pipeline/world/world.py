"""The world as far as it is known: the map that was given, and over it what the log has shown to be otherwise."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.kernels import world
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.maps.range_table import RangeCodes
from pipeline.world.rays import Rays
from pipeline.world.seen import SAME, UNKNOWN, WALL, Seen

MARGIN = 20.0
"""m: so far around the map land is thought of, as unknown; beyond it nothing that is known can be seen."""
CLEAR = 8.0
"""m: farther away, beams a degree apart pass by the ends of thin walls; what they pass is not counted, nor what they
hit."""
MOST = 20.0
"""Scans that are remembered of a cell: a door that was open is shut once some ten scans have seen it so."""


class World:
    """Rasters of FREE, WALL and UNKNOWN cells, the map's with MARGIN around it (``margin``, in cells).

    ``mapped`` (height, width) uint8: as the map has it; ``kinds``: with what the log has shown, which is in the rows
    and columns ``box``; ``changed``: how, as in ``Seen``. What scans say is counted by ``look``; it speaks from the
    next ``renew`` on. ``version`` counts how often it changed.
    """

    def __init__(self, grid: OccupancyGrid, threshold: float, scale: RangeCodes, width: int) -> None:
        self._grid, self._scale, self._width = grid, scale, width
        self.resolution = grid.resolution
        self.margin = math.ceil(MARGIN / grid.resolution)
        mapped = np.full([side + 2 * self.margin for side in (grid.height, grid.width)], UNKNOWN, np.uint8)
        inside = mapped[self.margin : self.margin + grid.height, self.margin : self.margin + grid.width]
        inside[:] = np.where(grid.known, grid.occupied(threshold).view(np.uint8), np.uint8(UNKNOWN))
        self.mapped = mapped
        self.kinds, self.box = self.mapped, (slice(0, 0), slice(0, 0))
        self.changed = np.zeros(mapped.shape, np.uint8)
        self.version = 0
        self._scans = 0
        self._before: Seen | None = None
        self._rays: dict[str, Rays] = {}
        self.forget()

    @property
    def own(self) -> Seen:
        """What the scans of this run alone have shown so far."""
        shape, grid = self.mapped.shape, self._grid
        hits, passes = self._hits.reshape(shape), self._passes.reshape(shape)
        return Seen(
            self.mapped, hits, passes, self.margin, grid.resolution, grid.origin, grid.sha256, within=self._looked
        )

    @property
    def seen(self) -> Seen:
        """What they have shown, and earlier runs, which count the less the more scans of this one saw a cell."""
        own, before = self.own, self._before
        if before is None:
            return own
        left = np.maximum(1.0 - (own.hits + own.passes) / np.float32(MOST), np.float32(0.0))
        hits, passes = own.hits + left * before.hits, own.passes + left * before.passes
        return replace(own, hits=hits, passes=passes, within=None)

    def begin_with(self, before: Seen) -> None:
        """Count on from what earlier runs have shown. Raises MclError if they had another map."""
        if before.map_sha256 != self._grid.sha256 or before.mapped.shape != self.mapped.shape:
            raise MclError("the memory is of a run on another map", "give a run on this one")
        total = before.hits + before.passes
        share = np.minimum(1.0, MOST / np.maximum(total, 1.0)).astype(np.float32)
        self._before = replace(before, hits=before.hits * share, passes=before.passes * share)
        self.renew()

    def forget(self) -> None:
        """Count anew."""
        n = self.mapped.size
        self._looked = (slice(0, 0), slice(0, 0))
        self._hits, self._passes = np.zeros(n, np.float32), np.zeros(n, np.float32)
        self._passed_at, self._hit_at = np.zeros(n, np.int32), np.zeros(n, np.int32)

    def look(self, laser: NDArray[np.float64], angles: NDArray[np.float64], ranges: NDArray[np.float32]) -> None:
        """Count what a scan saw from a pose (3,) of the laser, grid frame: ``angles`` (k,) rad, ``ranges`` (k,) m, NaN
        where nothing is known."""
        self._scans += 1
        cell = self._grid.resolution
        self._looked = self._with(laser)
        world.look(
            laser[0] / cell, laser[1] / cell, laser[2], angles, ranges / np.float32(cell), CLEAR / cell,
            self.mapped.shape[1], self.margin, self._scans, self._passed_at, self._hit_at, self._passes, self._hits,
            np.float32(MOST),
        )  # fmt: skip

    def renew(self) -> None:
        """Let what was counted speak."""
        seen = self.seen
        kinds = seen.kinds
        if not np.array_equal(kinds, self.kinds):
            self.kinds, self.box, self.changed = kinds, seen.box, seen.changed
            self.version += 1
            self._rays.clear()

    @property
    def walls(self) -> Rays:
        """Rays to the first wall, through whatever is unknown."""
        return self._cast("walls")

    @property
    def known(self) -> Rays:
        """Rays to the first cell of which anything is known."""
        return self._cast("known")

    @property
    def first(self) -> Rays:
        """Rays to whatever comes first, a wall or what is unknown."""
        return self._cast("first")

    def _cast(self, until: str) -> Rays:
        # Few runs need any: of a large map each takes as much memory as the map.
        if until not in self._rays:
            opaque = self.kinds
            if until != "first":
                opaque = (self.kinds == WALL if until == "walls" else self.kinds != UNKNOWN).view(np.uint8)
            self._rays[until] = Rays(opaque, self._scale, self._grid.resolution, self._width)
        return self._rays[until]

    def _with(self, laser: NDArray[np.float64]) -> tuple[slice, slice]:
        """Rows and columns that hold what was looked at so far, and what is seen from here."""
        cell, reach = self._grid.resolution, CLEAR + SAME + self._grid.resolution
        sides = []
        for place, side, size in zip(laser[[1, 0]], self._looked, self.mapped.shape, strict=True):
            first, last = (int((place + by) / cell) + self.margin for by in (-reach, reach))
            begin = first if side.stop == side.start else min(first, side.start)
            sides.append(slice(max(begin, 0), min(max(last + 1, side.stop), size)))
        return sides[0], sides[1]
