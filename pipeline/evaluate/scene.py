"""The map as it was and as it is being changed, and the drive that sees it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from pipeline.config import Config
from pipeline.evaluate.metrics import Array
from pipeline.evaluate.seen_walls import Drive, Mask
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.maps.walls import wall_half_thickness

CLEAR: Final = 0.3
"""m around the robot's way that nothing but a door of ``shut`` is put into."""
SMEAR: Final = 0.3
"""m from a wall up to which what is not floor belongs to it: beesoft maps draw walls half a metre thick."""
NEAR: Final = 4.0
"""m from the robot's way to boxes and doors, at most."""

Cells = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Rows and columns of some cells."""


@dataclass(frozen=True)
class Sketch:
    """A map in the making: ``occupancy`` (height, width) float32; ``gone``: seen wall that was taken away or moved;
    ``put``: wall that was not there before. Both of the same shape."""

    occupancy: NDArray[np.float32]
    gone: Mask
    put: Mask


@dataclass(frozen=True)
class Scene:
    """The map as it was, and the drive that sees it."""

    grid: OccupancyGrid
    drive: Drive
    config: Config

    @cached_property
    def walls(self) -> Mask:
        """Cells that stop a beam."""
        return self.grid.occupied(self.grid.wall_threshold(self.config.occupied_threshold))

    @cached_property
    def seen(self) -> Mask:
        """Those of them on which beams end."""
        return self.drive.seen(self.walls)

    @cached_property
    def seen_cells(self) -> NDArray[np.int64]:
        """(n, 2) rows and columns of the seen wall."""
        return np.argwhere(self.seen)

    @cached_property
    def from_way(self) -> Array:
        """Metres of every cell from where the robot's centre was."""
        off = np.ones(self.walls.shape, np.bool_)
        way = np.floor(self.drive.way).astype(np.int64)
        cols, rows = way[:, 0], way[:, 1]
        inside = (rows >= 0) & (cols >= 0) & (rows < self.grid.height) & (cols < self.grid.width)
        off[rows[inside], cols[inside]] = False
        return np.asarray(distance_transform_edt(off)) * self.grid.resolution

    @cached_property
    def beside(self) -> NDArray[np.int64]:
        """(n, 2) rows and columns of the floor near the robot's way, but not in it."""
        floor = self.grid.free(self.config.free_threshold)
        return np.argwhere(floor & (self.from_way > CLEAR) & (self.from_way <= NEAR))

    @cached_property
    def by_walls(self) -> Mask:
        """Cells that are wall, or within SMEAR of it."""
        return np.asarray(distance_transform_edt(~self.walls)) * self.grid.resolution <= SMEAR

    @cached_property
    def half(self) -> float:
        """Half of what the map makes a wall thick, m; at least three quarters of a cell, which leaves no gaps."""
        return max(
            wall_half_thickness(self.grid, self.grid.wall_threshold(self.config.occupied_threshold)),
            0.75 * self.grid.resolution,
        )

    @cached_property
    def floor(self) -> np.float32:
        """What the map says of floor."""
        floor = self.grid.occupancy[self.grid.free(self.config.free_threshold)]
        return np.float32(np.median(floor) if len(floor) else 0.0)

    @cached_property
    def wall(self) -> np.float32:
        """What the map says of walls."""
        return np.float32(np.median(self.grid.occupancy[self.walls]))

    def changed(self, sketch: Sketch) -> float:
        """The share of the seen wall that is gone, and the new wall that is seen, as a share of the same."""
        seen = int(np.sum(self.drive.seen(self.occupied(sketch)) & sketch.put)) if sketch.put.any() else 0
        return (int(np.sum(sketch.gone)) + seen) / len(self.seen_cells)

    def occupied(self, sketch: Sketch) -> Mask:
        """Cells of the sketch that stop a beam."""
        return sketch.occupancy >= np.float32(self.grid.wall_threshold(self.config.occupied_threshold))

    def cells(self, middle: Array, direction: Array, half_length: float, half_width: float) -> Cells:
        """Rows and columns of the cells in a rectangle: ``middle`` in cells (row, column), the rest in metres."""
        length, width = half_length / self.grid.resolution, half_width / self.grid.resolution
        reach = math.hypot(length, width) + 1.0
        low = np.maximum(np.floor(middle - reach), 0).astype(np.int64)
        high = np.minimum(np.ceil(middle + reach), np.array(self.walls.shape) - 1).astype(np.int64)
        rows, cols = np.mgrid[low[0] : high[0] + 1, low[1] : high[1] + 1]
        along = (rows - middle[0]) * direction[0] + (cols - middle[1]) * direction[1]
        across = (cols - middle[1]) * direction[0] - (rows - middle[0]) * direction[1]
        inside = (np.abs(along) <= length) & (np.abs(across) <= width)
        return rows[inside], cols[inside]

    def built(self, sketch: Sketch, cells: Cells) -> Cells:
        """Those of the cells that are wall, or what smears it: anything but floor, known, and close to wall."""
        something = sketch.occupancy[cells] >= np.float32(self.config.free_threshold)
        something &= self.by_walls[cells] | sketch.put[cells] | self.occupied(sketch)[cells]
        return cells[0][something], cells[1][something]
