"""Extended Kalman filter localization (Probabilistic Robotics, Table 7.2): one Gaussian, corrected by walls as lines.

The landmarks are the straight walls that the scan shows; which wall of the map each of them is, is told by where its
beams should end, cast from the predicted pose (maximum likelihood with a gate, Section 7.5).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.filter.lines import SHORTEST, Line, apart, find_lines, fit_line
from pipeline.filter.range_bias import LARGEST
from pipeline.geometry import compose, wrap_angle
from pipeline.kernels import raycast
from pipeline.logs.messages import Laser, Scan
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.maps.range_table import opaque_cells
from pipeline.maps.walls import wall_half_thickness
from pipeline.motion.models import Component

Array = NDArray[np.float64]

GATE = 9.21
"""Chi-square with two degrees of freedom: 99 % of the lines that are the expected wall lie within."""
STRAIGHT = 0.15
"""m: where the map's cells are farther from one line, in the mean, the map has no straight wall there."""
MAP_TURN, MAP_SHIFT = 0.02, 0.05
"""rad, m: deviation of a wall of the map from where it really is. Scan after scan sees the same wall with the same
error, so that the filter is surer than it should be; but with twice as much, lines are taken for other walls, and it
gets lost in Intel's building and in Wean Hall."""
MOST_BEAMS = 361


class Ekf:
    """A Gaussian belief over the pose, from a known start.

    ``update`` is that of a filter of the user's own: nothing but the scan and the step comes in, and the pose with its
    covariance goes out. Raises MclError without an initial pose.
    """

    def __init__(self, grid: OccupancyGrid, laser: Laser, config: Config, max_range: float) -> None:
        if config.init != "pose" or config.initial_pose is None:
            raise MclError("filter=ekf follows one place from a known start", "give it with --pose X,Y,YAW")
        self._grid, self._laser, self._max_range = grid, laser, max_range
        self._beams = np.arange(0, laser.beams, -(-laser.beams // MOST_BEAMS))
        self._angles = laser.angles[self._beams]
        self._opaque = opaque_cells(grid, grid.wall_threshold(config.occupied_threshold))
        half = min(wall_half_thickness(grid, grid.wall_threshold(config.occupied_threshold)), LARGEST)
        self._bias = half if config.range_bias is None else config.range_bias
        self._no_return = config.no_return_fraction * max_range
        self._mean = np.array(config.initial_pose, np.float64)
        self._covariance = np.diag(np.maximum(config.initial_pose_std, 1e-3)) ** 2

    def update(self, scan: Scan, step: Component | None) -> tuple[Array, Array]:
        """Predict by the step, None at the first scan, and correct by the lines of the scan; pose and covariance."""
        if step is not None:
            self._predict(step)
        self._correct(self._points(scan.ranges))
        return self._mean.copy(), self._covariance.copy()

    def _predict(self, step: Component) -> None:
        """Table 7.2, lines 2 to 7, with the step's covariance told in the robot's frame."""
        before, self._mean = self._mean, compose(self._mean, step.step)
        dx, dy = self._mean[:2] - before[:2]
        by_pose = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        cos, sin = math.cos(before[2]), math.sin(before[2])
        by_step = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        self._covariance = by_pose @ self._covariance @ by_pose.T + by_step @ step.covariance @ by_step.T

    def _correct(self, points: Array) -> None:
        """Table 7.2, lines 9 to 20, for every line that the scan shows."""
        lines = find_lines(points)
        if not lines:
            return
        expected = self._expected()
        predicted = self._mean.copy()
        for seen in lines:
            if (wall := self._wall(seen, expected)) is not None:
                self._match(seen, wall, predicted)

    def _match(self, seen: Line, wall: Line, predicted: Array) -> None:
        """One landmark: ``wall`` is the map's line as it would be seen from the ``predicted`` pose."""
        # Where that wall is in the map, and how it would be seen from where the mean is by now.
        normal = wall.alpha + predicted[2]
        cos, sin = math.cos(normal), math.sin(normal)
        moved = self._mean - predicted
        now = Line(normal - self._mean[2], wall.r - cos * moved[0] - sin * moved[1], wall.covariance, wall.members, 0.0)
        innovation = apart(seen, now)
        jacobian = np.array([[0.0, 0.0, -1.0], [-cos, -sin, 0.0]])
        noise = seen.covariance + np.diag([MAP_TURN, MAP_SHIFT]) ** 2
        spread = jacobian @ self._covariance @ jacobian.T + noise
        if innovation @ np.linalg.solve(spread, innovation) > GATE:
            return
        gain = np.linalg.solve(spread, jacobian @ self._covariance).T
        self._mean = self._mean + gain @ innovation
        self._mean[2] = float(wrap_angle(self._mean[2]))
        # Joseph's form: it stays symmetric and positive.
        left = np.eye(3) - gain @ jacobian
        self._covariance = left @ self._covariance @ left.T + gain @ noise @ gain.T

    def _wall(self, seen: Line, expected: Array) -> Line | None:
        """The wall of the map at which a line's beams should end, None if they should not end at a single one."""
        ends = expected[seen.members]
        there = np.isfinite(ends).all(axis=1)
        if np.count_nonzero(there) < max(3, len(ends) // 2):
            return None
        if math.dist(ends[there][0], ends[there][-1]) < SHORTEST:
            return None  # a pose in a wall sees it everywhere at once
        line = fit_line(ends[there], seen.members[there])
        return line if line.rms < STRAIGHT else None

    def _points(self, ranges: NDArray[np.float32]) -> Array:
        """(k, 2) m where the beams ended, in the robot's frame, NaN where nothing came back."""
        r = ranges[self._beams].astype(np.float64)
        r[~(r < self._no_return)] = np.nan
        return self._ends(np.maximum(r - self._bias, 0.0))

    def _expected(self) -> Array:
        """(k, 2) m where the beams should end from where the mean is, in the robot's frame, NaN where nothing is."""
        cell = self._grid.resolution
        at = self._grid.to_grid(compose(self._mean, np.asarray(self._laser.pose, np.float64)))
        in_cells = np.array([[at[0] / cell, at[1] / cell, at[2]]])
        found = np.empty((1, len(self._beams)), np.float32)
        raycast.cast(self._opaque, in_cells, self._angles, self._max_range / cell, False, found)
        ranges = found[0].astype(np.float64) * cell
        ranges[~(ranges < self._max_range)] = np.nan
        return self._ends(ranges)

    def _ends(self, ranges: Array) -> Array:
        x, y, yaw = self._laser.pose
        return np.stack([x + ranges * np.cos(self._angles + yaw), y + ranges * np.sin(self._angles + yaw)], axis=1)
