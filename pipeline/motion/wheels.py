"""The odometry motion model (Probabilistic Robotics, Section 5.4 and Table 5.6)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.geometry import between, wrap_angle

ON_THE_SPOT = 0.01
"""Metres. The direction of a shorter drive is noise of the odometry; it must not count as two turns (as in AMCL)."""


@dataclass(frozen=True)
class OdometryMotion:
    """What the odometry says of a move: turn by rot1, drive trans, turn by rot2 (rad, m, rad), with deviations.

    Driving backwards is a negative ``trans``, not a turn by pi and back: its noise is that of the drive forwards.
    """

    rot1: float
    trans: float
    rot2: float
    std_rot1: float
    std_trans: float
    std_rot2: float


def odometry_motion(before: NDArray[np.float64], after: NDArray[np.float64], config: Config) -> OdometryMotion:
    """Table 5.6, lines 2 to 7: the move between two odometry poses (x, y, yaw), and the deviations of its noise."""
    dx, dy, turn = (float(v) for v in between(before, after))
    trans = math.hypot(dx, dy)
    rot1 = math.atan2(dy, dx) if trans > 0.0 else 0.0
    if abs(rot1) > math.pi / 2:
        rot1, trans = float(wrap_angle(rot1 + math.pi)), -trans
    rot2 = float(wrap_angle(turn - rot1))
    turn1, turn2 = (rot1, rot2) if abs(trans) >= ON_THE_SPOT else (0.0, turn)
    return OdometryMotion(
        rot1,
        trans,
        rot2,
        std_rot1=math.sqrt(config.alpha1 * turn1**2 + config.alpha2 * trans**2),
        std_trans=math.sqrt(config.alpha3 * trans**2 + config.alpha4 * (turn1**2 + turn2**2)),
        std_rot2=math.sqrt(config.alpha1 * turn2**2 + config.alpha2 * trans**2),
    )
