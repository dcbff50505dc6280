"""Scans of a laser that is carried along while it turns, as it would have measured them standing still."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.deskew import carry
from pipeline.logs.messages import Laser


def deskew(ranges: NDArray[np.float32], laser: Laser, sweep: NDArray[np.float64]) -> NDArray[np.float32]:
    """The same regular beams as seen from where the robot was at the scan's stamp, when its first beam was measured.

    ``ranges`` (beams,) float32 m, NaN = invalid, inf = no return, measured while the robot moved by ``sweep`` (3,) m,
    m, rad in its own frame, at constant velocity, from the first-measured beam to the last. Returns (beams,) float32
    m: each beam's end is carried into the frame of the stamp, and a regular beam lies between the two neighbours
    there: on the line between them where both are on one surface, else as far as the nearer of them; NaN where nothing
    was measured. A robot that stood still, a sweep that nobody knows (NaN), or a laser whose beams are all of the
    stamp, gives ``ranges`` itself.
    """
    x, y, turn = (float(value) for value in sweep)
    if laser.beams < 2 or laser.time_increment == 0.0 or x == y == turn == 0.0 or not math.isfinite(x + y + turn):
        return ranges
    # The laser's own motion: the robot's, seen from the laser.
    at_x, at_y, yaw = laser.pose
    cos, sin = math.cos(turn), math.sin(turn)
    moved_x, moved_y = x + (cos - 1.0) * at_x - sin * at_y, y + sin * at_x + (cos - 1.0) * at_y
    cos, sin = math.cos(yaw), math.sin(yaw)
    out = np.empty(laser.beams, np.float32)
    carry(
        ranges,
        laser.angle_min,
        laser.angle_increment,
        laser.time_increment < 0.0,
        cos * moved_x + sin * moved_y,
        cos * moved_y - sin * moved_x,
        turn,
        np.float32(laser.range_min),
        np.float32(laser.range_max),
        out,
    )
    return out
