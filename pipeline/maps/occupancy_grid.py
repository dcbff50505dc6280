"""The map: how probable it is that a cell of the floor is occupied."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.errors import MclError
from pipeline.geometry import Pose, compose, inverse

LARGE = 16_000_000
"""Cells above which only the part of a map is kept that says anything."""
MOST_CELLS, BYTES_EACH = 100_000_000, 71
"""Cells that a map may have, and what each takes in memory until the first scan is in."""
CERTAIN, LIKELY = 0.97, 0.65
"""Probabilities from which on a cell is a wall: of maps with saturated walls, and of grey ones (nav2's default)."""
ENOUGH = 0.25
"""Share of the cells on the walls' surface that must be CERTAIN, or the walls are grey. It is 0.46 in Wean Hall, 0.77
in the embedded office, 1 in every map of two colours, and at most 0.07 in maps made with a smear of a cell."""


@dataclass(frozen=True)
class OccupancyGrid:
    """Occupancy probabilities on a grid, as nav_msgs/OccupancyGrid lays them out.

    ``occupancy``: (height, width) float32, row 0 at the lowest y, NaN = unknown, else in [0, 1];
    ``resolution``: metres per cell; ``origin``: pose of the lower left corner of cell (0, 0) in the map frame.
    ``remarks``: what a user should know of how the map was read; no part of its identity.
    The *grid frame* has its origin at that corner and its axes along the rows and columns: with it
    the filter needs to know nothing of the map's origin and yaw.
    """

    occupancy: NDArray[np.float32]
    resolution: float
    origin: Pose = (0.0, 0.0, 0.0)
    remarks: tuple[str, ...] = ()

    def __repr__(self) -> str:
        x, y, yaw = self.origin
        return f"OccupancyGrid({self.size}, origin ({x:g}, {y:g}) m, {math.degrees(yaw):g} deg)"

    def _repr_html_(self) -> str:
        from pipeline.maps.picture import figure, map_svg  # it needs Pillow

        return figure(map_svg(self), repr(self))

    @property
    def size(self) -> str:
        """How large it is, in words."""
        return f"{self.width} x {self.height} cells of {self.resolution:g} m"

    @property
    def height(self) -> int:
        """Cells along y."""
        return int(self.occupancy.shape[0])

    @property
    def width(self) -> int:
        """Cells along x."""
        return int(self.occupancy.shape[1])

    def occupied(self, threshold: float) -> NDArray[np.bool_]:
        """Cells known to be occupied with at least this probability."""
        return self.occupancy >= np.float32(threshold)

    def wall_threshold(self, asked: float | None) -> float:
        """The probability from which on a cell stops rays: the one ``asked`` for, else what suits this map.

        Walls that are smeared are thinnest, and nearest to where the laser sees them, at CERTAIN. But a map may draw
        all of its walls in grey: then few of their cells are so certain, and rays would pass between them.
        """
        return self._own_threshold if asked is None else asked

    @cached_property
    def _own_threshold(self) -> float:
        likely = self.occupied(LIKELY)
        floor = np.pad(self.known & ~likely, 1)
        beside_floor = floor[:-2, 1:-1] | floor[2:, 1:-1] | floor[1:-1, :-2] | floor[1:-1, 2:]
        surface = self.occupancy[likely & beside_floor]
        certain = np.mean(surface >= np.float32(CERTAIN)) if len(surface) else 1.0
        return CERTAIN if certain >= ENOUGH else LIKELY

    def free(self, threshold: float) -> NDArray[np.bool_]:
        """Cells known to be occupied with less than this probability."""
        return self.occupancy < np.float32(threshold)

    @property
    def known(self) -> NDArray[np.bool_]:
        """Cells of which the map says anything."""
        return ~np.isnan(self.occupancy)

    @property
    def known_area(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest (x, y), m in the map frame, of the cells of which the map says anything, else of all."""
        rows, columns = np.nonzero(self.known) if self.known.any() else np.nonzero(np.isnan(self.occupancy))
        x, y = ((self.resolution * np.array([k.min(), k.max() + 1])) for k in (columns, rows))
        corners = self.to_map([(i, j, 0.0) for i in x for j in y])[:, :2]
        return corners.min(axis=0), corners.max(axis=0)

    def to_grid(self, poses: ArrayLike) -> NDArray[np.float64]:
        """Poses (..., 3) of the map frame, expressed in the grid frame."""
        return compose(inverse(self.origin), poses)

    def to_map(self, poses: ArrayLike) -> NDArray[np.float64]:
        """Poses (..., 3) of the grid frame, expressed in the map frame."""
        return compose(self.origin, poses)

    @cached_property
    def sha256(self) -> str:
        """Checksum of cells, resolution and origin: the map's identity in caches and run records."""
        digest = hashlib.sha256(np.ascontiguousarray(self.occupancy).tobytes())
        # As plain numbers: numpy's scalars have the same value and another repr.
        origin = tuple(float(value) for value in self.origin)
        digest.update(repr(((self.height, self.width), float(self.resolution), origin)).encode())
        return digest.hexdigest()


def part_that_is_known(levels: NDArray[np.integer[Any]], known: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Rows and columns of the smallest part of an image that holds all pixels of levels that are ``known`` (levels,).

    The whole image if there are none.
    """
    block = 1024
    rows = np.concatenate([known[levels[i : i + block]].any(axis=1) for i in range(0, len(levels), block)])
    if not rows.any():
        return slice(0, levels.shape[0]), slice(0, levels.shape[1])
    first, last = np.flatnonzero(rows)[[0, -1]].tolist()
    columns = np.zeros(levels.shape[1], np.bool_)
    for i in range(first, last + 1, block):
        columns |= known[levels[i : min(i + block, last + 1)]].any(axis=0)
    left, right = np.flatnonzero(columns)[[0, -1]].tolist()
    return slice(first, last + 1), slice(left, right + 1)


def cropped(shape: tuple[int, ...], rows: slice, columns: slice) -> str:
    """A remark on what was kept of a large map."""
    height, width = rows.stop - rows.start, columns.stop - columns.start
    return f"of its {shape[1]:,} x {shape[0]:,} cells the {width:,} x {height:,} are kept that say anything"


def check_cells(shape: tuple[int, ...], path: Path | None = None) -> None:
    """Raises MclError if a map of this shape is too large; ``path`` names it."""
    height, width = shape
    if height * width > MOST_CELLS:
        need = height * width * BYTES_EACH / 1e9
        raise MclError(
            f"a map of {width:,} x {height:,} cells would need about {need:.0f} GB of memory",
            "use larger cells, or a part of it",
            path=path,
        )
