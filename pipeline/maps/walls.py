"""How thick the map draws its walls."""

from __future__ import annotations

import numpy as np

from pipeline.maps.occupancy_grid import OccupancyGrid

THICKEST = 0.5
"""Metres: what is thicker is a filled block, not a wall that was smeared."""


def wall_half_thickness(grid: OccupancyGrid, threshold: float) -> float:
    """Mean distance from the middle of the map's walls to their border, m.

    A map made from scans smears each wall over the cells that its noise reached, to both sides; the laser sees the
    middle. So a ray in the map stops short by about this much.
    """
    from scipy import ndimage

    occupied = grid.occupied(threshold)
    depth = ndimage.distance_transform_edt(occupied) * grid.resolution
    middle = occupied & (depth == ndimage.maximum_filter(depth, 3)) & (depth <= THICKEST)
    return float(depth[middle].mean()) if np.any(middle) else 0.0
