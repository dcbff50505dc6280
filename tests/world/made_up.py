"""A little made-up map for tests of the world: a room, and beside it unknown land with a wall at its far end."""

from __future__ import annotations

import math

import numpy as np

from pipeline.logs.messages import Laser
from pipeline.maps.occupancy_grid import OccupancyGrid

CELL = 0.1
ROUND = Laser((0.0, 0.0, 0.0), -math.pi, math.pi / 180, beams=360, range_min=0.0, range_max=12.0)
"""Beam k looks at k - 180 degrees."""
ORIGIN = (3.0, -2.0, 0.7)
IN_THE_ROOM, BEYOND = (1.5, 2.0, 0.0), (4.0, 2.0, 0.0)
"""Poses of the grid frame, m and rad, on known floor and off the map."""
DOOR, FAR_WALL = 3.05, 5.5
"""m: where the room ends in x, with a door from y 1.5 to 2.5; and where the far wall begins."""


def room_beside_the_unknown() -> OccupancyGrid:
    """6 m by 4 m: the room is 3 m long, then comes what is unknown, and a wall that somebody has seen from outside."""
    cells = np.full((40, 60), np.nan, np.float32)
    cells[:, :31] = 0.0
    cells[[0, -1], :31] = 1.0
    cells[:, [0, 30]] = 1.0
    cells[15:25, 30] = 0.0
    cells[:, 55] = 1.0
    return OccupancyGrid(cells, CELL, ORIGIN)
