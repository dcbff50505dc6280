"""A move in words."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

STILL, STILL_TURN = 0.005, math.radians(0.5)
"""m, rad: less is not worth a word."""


def in_words(step: NDArray[np.float64], digits: int = 2) -> str:
    """A ``step`` (3,) m, m, rad in the robot's own frame, such as "0.84 m forwards and 12 deg left"."""
    distance, turn = math.hypot(step[0], step[1]), math.degrees(step[2])
    told = []
    if distance >= STILL:
        way = math.atan2(step[1], step[0])
        side = "to the left" if way > 0.0 else "to the right"
        where = "forwards" if abs(way) < math.pi / 3 else "backwards" if abs(way) > 2 * math.pi / 3 else side
        told.append(f"{distance:.{digits}f} m {where}")
    if abs(step[2]) >= STILL_TURN:
        told.append(f"{abs(turn):.0f} deg {'left' if turn > 0.0 else 'right'}")
    return " and ".join(told) if told else "no move"
