"""Which walls of a map the laser's beams end on during a drive: whatever else the map holds, no scan tells of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluate.metrics import Array, known
from pipeline.geometry import compose, wrap_angle
from pipeline.logs.messages import Laser
from pipeline.maps.occupancy_grid import OccupancyGrid

Mask = NDArray[np.bool_]

APART = (0.3, np.radians(15.0))
"""m, rad that the robot moves from one pose that is looked from to the next; more where that would be MOST or more."""
MOST = 400
BEAMS = 180
"""Beams at a pose, at most."""
_INTO = 0.01
"""Cells by which a beam is followed into the wall that stopped it."""


@dataclass(frozen=True)
class Drive:
    """Where a laser looked from: ``poses`` (n, 3) of the laser, cells and radians, in the grid frame; ``angles`` (k,).

    ``max_range`` in cells; ``way`` (m, 2): where the robot's centre was, cells.
    """

    poses: Array
    angles: Array
    max_range: float
    way: Array

    def seen(self, walls: Mask) -> Mask:
        """The cells of ``walls`` (height, width) on which at least one beam ends, of the same shape."""
        from pipeline.kernels.raycast import cast  # here, so that a process sets its threads before it meets numba

        ranges = np.empty((len(self.poses), len(self.angles)), np.float32)
        cast(walls.astype(np.uint8), self.poses, self.angles, self.max_range, False, ranges)
        pose, beam = np.nonzero(np.isfinite(ranges))
        direction = self.poses[pose, 2] + self.angles[beam]
        length = ranges[pose, beam] + _INTO
        cols = np.floor(self.poses[pose, 0] + length * np.cos(direction)).astype(np.int64)
        rows = np.floor(self.poses[pose, 1] + length * np.sin(direction)).astype(np.int64)
        found = np.zeros(walls.shape, np.bool_)
        inside = (rows >= 0) & (cols >= 0) & (rows < walls.shape[0]) & (cols < walls.shape[1])
        found[rows[inside], cols[inside]] = True
        # A beam that grazes a corner may come out beside it.
        return found & walls


def drive(truth: Array, laser: Laser, grid: OccupancyGrid, max_range: float) -> Drive:
    """The drive of a robot that was at ``truth`` (n, 3), m, m, rad in the map frame, NaN where unknown.

    ``max_range``: the longest range that counts, m.
    """
    robot = grid.to_grid(truth[known(truth)])
    poses = compose(robot[_apart(robot)], laser.pose)
    beams = laser.angles[:: -(-laser.beams // BEAMS)]
    scale = np.array([1.0 / grid.resolution, 1.0 / grid.resolution, 1.0])
    return Drive(
        np.ascontiguousarray(poses * scale),
        np.ascontiguousarray(beams),
        max_range / grid.resolution,
        robot[:, :2] / grid.resolution,
    )


def _apart(poses: Array) -> NDArray[np.int64]:
    """Rows of poses (n, 3), each moved APART from the one before, at most MOST of them."""
    rows, last = [0], poses[0]
    for row, pose in enumerate(poses):
        far = np.hypot(*(pose[:2] - last[:2])) >= APART[0]
        if far or abs(float(wrap_angle(pose[2] - last[2]))) >= APART[1]:
            rows.append(row)
            last = pose
    return np.array(rows)[:: -(-len(rows) // MOST)]
