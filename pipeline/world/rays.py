"""What a laser would see from where the map's own table of ranges has no row: rows are cast when first looked at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels import table
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.maps.range_table import RangeCaster, RangeCodes

FREE, WALL, UNKNOWN = 0, 1, 2
MARGIN = 20.0
"""m: so far around the map land is thought of, as unknown; beyond it nothing that is known can be seen."""


class Rays:
    """Rays through unknown land, which is transparent: to the first mapped wall, and to the first known cell.

    ``kinds`` (height, width) uint8 is the map with MARGIN around it: FREE, WALL or UNKNOWN; ``margin``: that in cells.
    """

    def __init__(self, grid: OccupancyGrid, threshold: float, codes: RangeCodes, width: int) -> None:
        self.margin = int(np.ceil(MARGIN / grid.resolution))
        kinds = np.where(grid.known, grid.occupied(threshold), UNKNOWN).astype(np.uint8)
        self.kinds = np.pad(kinds, self.margin, constant_values=UNKNOWN)
        self._codes, self._resolution, self._width = codes, grid.resolution, width
        self._row_of_cell = np.zeros(self.kinds.size, np.int32)
        self._casters: tuple[RangeCaster, RangeCaster] | None = None
        # Row 0: nothing that is known can be seen.
        self.by_map = np.full((64, width), 255, np.uint8)
        self.known_from = np.full((64, width), 255, np.uint8)
        self._rows = 1

    def rows(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        """(n,) rows of ``by_map`` and ``known_from`` for lasers in flat ``cells`` (n,) of ``kinds``; -1: off it."""
        off = cells < 0
        rows = self._row_of_cell[np.where(off, 0, cells)].astype(np.int64)
        if ((rows == 0) & ~off).any():
            self._cast(np.unique(cells[(rows == 0) & ~off]))
            rows = self._row_of_cell[np.where(off, 0, cells)].astype(np.int64)
        rows[off] = 0
        return rows

    def _cast(self, cells: NDArray[np.int64]) -> None:
        if self._casters is None:
            walls, known = self.kinds == WALL, self.kinds != UNKNOWN
            self._casters = (
                RangeCaster(walls.astype(np.uint8), self._codes, self._resolution),
                RangeCaster(known.astype(np.uint8), self._codes, self._resolution),
            )
        end = self._rows + len(cells)
        if end > len(self.by_map):
            self.by_map, self.known_from = (_longer(a, 2 * end) for a in (self.by_map, self.known_from))
        for caster, out in zip(self._casters, (self.by_map, self.known_from), strict=True):
            caster.cast(cells, out[self._rows : end])
        self._row_of_cell[cells] = np.arange(self._rows, end, dtype=np.int32)
        self._rows = end


def _longer(rows: NDArray[np.uint8], n: int) -> NDArray[np.uint8]:
    out = np.empty((n, rows.shape[1]), np.uint8)
    out[: len(rows)] = rows
    return out
