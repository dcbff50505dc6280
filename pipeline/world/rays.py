"""Ranges through a raster, for the few cells that somebody asks about: a row is cast when it is first looked at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.maps.range_table import RangeCaster, RangeCodes


class Rays:
    """Codes of the range in every heading, as ``maps.RangeTable`` has them, from cells of a raster.

    ``codes`` (rows, headings and more) uint8, of which row 0 is a laser that sees nothing: 255 in all headings. It is
    another array once rows have been added. The raster, ``opaque`` (height, width) uint8, is as ``RangeCaster`` has it.
    """

    def __init__(self, opaque: NDArray[np.uint8], scale: RangeCodes, resolution: float, width: int) -> None:
        self._opaque, self._scale, self._resolution = opaque, scale, resolution
        self._caster: RangeCaster | None = None
        self._row_of_cell = np.zeros(opaque.size, np.int32)
        self.codes = np.full((64, width), 255, np.uint8)
        self._used = 1

    def rows(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        """(n,) rows of ``codes`` for lasers in flat ``cells`` (n,) of the raster, -1 off it."""
        off = cells < 0
        rows = self._row_of_cell[np.where(off, 0, cells)].astype(np.int64)
        rows[off] = 0
        if (new := (rows == 0) & ~off).any():
            self._cast(np.unique(cells[new]))
            rows[new] = self._row_of_cell[cells[new]]
        return rows

    def _cast(self, cells: NDArray[np.int64]) -> None:
        if self._caster is None:
            self._caster = RangeCaster(self._opaque, self._scale, self._resolution)
        end = self._used + len(cells)
        if end > len(self.codes):
            longer = np.empty((2 * end, self.codes.shape[1]), np.uint8)
            longer[: self._used] = self.codes[: self._used]
            self.codes = longer
        self._caster.cast(cells, self.codes[self._used : end])
        self._row_of_cell[cells] = np.arange(self._used, end, dtype=np.int32)
        self._used = end
