"""Scans of a laser that is carried along while it turns, as it would have measured them standing still."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

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


NOTABLE = 0.02
"""rad: a scan in which the robot turns by less says nothing of the order of its beams."""
MEMORY = 0.99
"""What is left of a scan's word at the next one that turns: some hundred of them decide."""
TRUST = 0.05
"""Fit that the log's own word is ahead at the start."""


class Deskewer:
    """Takes the robot's motion out of scans, if the walls confirm what the log says of the times of beams.

    There are drivers that turn the order of the beams round without saying so, and lasers whose scans were put right
    before they were recorded. So three ways are compared by how well scans fit the walls seen before: as the log says,
    as measured, and with the order of the beams reversed.
    """

    def __init__(self, laser: Laser) -> None:
        self._orders = (laser, None, replace(laser, time_increment=-laser.time_increment))
        self._evidence = np.array([TRUST, 0.0, 0.0])
        self.duration = abs(laser.time_increment) * (laser.beams - 1)
        """Seconds from the first beam to the last; 0 if all are of the stamp, and nothing is to be done."""

    def __call__(
        self,
        ranges: NDArray[np.float32],
        sweep: NDArray[np.float64],
        fit: Callable[[NDArray[np.float32]], float],
    ) -> NDArray[np.float32]:
        """The ranges (beams,) in the way that is best confirmed; ``fit`` tells how well ranges fit the walls."""
        ways = [ranges if order is None else deskew(ranges, order, sweep) for order in self._orders]
        if abs(sweep[2]) > NOTABLE:
            self._evidence = MEMORY * self._evidence + np.array([fit(way) for way in ways])
        return ways[int(np.argmax(self._evidence))]
