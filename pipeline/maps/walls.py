"""How thick the map draws its walls."""

from __future__ import annotations

import itertools

import numpy as np

from pipeline.kernels.nearest import nearest
from pipeline.maps.occupancy_grid import OccupancyGrid

THICKEST = 0.5
"""Metres: what is thicker is a filled block, not a wall that was smeared."""


def wall_half_thickness(grid: OccupancyGrid, threshold: float) -> float:
    """Mean distance from the middle of the map's walls to their border, m.

    A map made from scans smears each wall over the cells that its noise reached, to both sides; the laser sees the
    middle. So a ray in the map stops short by about this much.
    """
    occupied = grid.occupied(threshold)
    squared, at = np.empty(occupied.shape, np.int32), np.empty(occupied.shape, np.int32)
    nearest(~occupied, int(THICKEST / grid.resolution) + 2, squared, at)
    depth = np.sqrt(squared)
    around = np.pad(depth, 1)
    height, width = depth.shape
    # The middle of a wall is as deep as all of its eight neighbours, or deeper.
    middle = occupied & (depth * grid.resolution <= THICKEST)
    for row, col in itertools.product(range(3), range(3)):
        middle &= depth >= around[row : row + height, col : col + width]
    if not np.any(middle):
        return 0.0
    # The centre of the nearest cell outside is half a cell farther than the wall's border. Where a wall has two middle
    # cells, each lies half a cell beside its true middle, which makes up for it: only a lone one is too deep.
    across = np.maximum(around[1:-1, :-2], around[1:-1, 2:]), np.maximum(around[:-2, 1:-1], around[2:, 1:-1])
    lone = np.minimum(*across) < depth
    return float(np.mean(depth[middle] - 0.5 * lone[middle])) * grid.resolution
