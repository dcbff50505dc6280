"""How far it is from every cell to the nearest occupied one: what the likelihood field is made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.maps.occupancy_grid import OccupancyGrid


@dataclass(frozen=True)
class DistanceField:
    """Distances between the centres of cells, each one of a few that squares of whole numbers allow.

    ``codes`` (height, width) uint16: index into ``distances`` (m,) float64, metres, ascending; the last of these is the
    largest distance that counts, also outside the map. No distance is rounded.
    """

    codes: NDArray[np.uint16]
    distances: NDArray[np.float64]


def build_distance_field(grid: OccupancyGrid, threshold: float, max_dist: float) -> DistanceField:
    """Euclidean distance to the nearest cell occupied with at least ``threshold``, at most ``max_dist`` metres.

    Unknown cells are no obstacles, and have a distance like free ones, as in AMCL's map_update_cspace. (AMCL spreads
    distances from neighbour to neighbour, which makes a few of them too long; these are exact.)
    Raises MclError if ``max_dist`` spans so many cells that sixteen bits cannot tell the distances apart.
    """
    from scipy import ndimage

    far = max_dist / grid.resolution
    occupied = grid.occupied(threshold)
    if np.any(occupied):
        # Squares of distances in cells are whole numbers: exact, and easily told apart.
        squares = np.rint(ndimage.distance_transform_edt(~occupied) ** 2)
        cells = np.sqrt(np.where(squares < far * far, squares, np.inf))
    else:
        cells = np.full(occupied.shape, np.inf)
    seen, codes = np.unique(np.append(cells.reshape(-1), np.inf), return_inverse=True)
    if len(seen) > np.iinfo(np.uint16).max:
        raise MclError(f"a likelihood field of {far:.0f} cells is too wide", "lower laser_likelihood_max_dist")
    distances = np.where(np.isinf(seen), max_dist, seen * grid.resolution)
    field = codes[:-1].reshape(occupied.shape).astype(np.uint16)
    return DistanceField(np.ascontiguousarray(field), distances)
