"""True ranges: how far a ray goes in the map before something stops it.

All lengths are in cells, poses in the grid frame (cell (0, 0) covers [0, 1) x [0, 1)). ``opaque`` is (height, width)
uint8: 0 lets a ray pass, anything else stops it. A ray that starts in an opaque cell has range 0; one that leaves the
map, or goes further than ``max_range``, has range inf.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pipeline.kernels import inline, kernel, paired


@inline
def dda(opaque, x, y, cos, sin, max_range):
    """Range by Amanatides and Woo (1987): every cell that the ray crosses, in order; exact to the cell's border.

    Returns (range in cells, value of the cell that stopped it).
    """
    height, width = opaque.shape
    col, row = int(math.floor(x)), int(math.floor(y))
    if col < 0 or row < 0 or col >= width or row >= height:
        return np.inf, 0
    if opaque[row, col] != 0:
        return 0.0, int(opaque[row, col])
    step_x = 1 if cos > 0.0 else -1
    step_y = 1 if sin > 0.0 else -1
    # Distance along the ray between two vertical (horizontal) cell borders, and to the first of them.
    delta_x = abs(1.0 / cos) if cos != 0.0 else np.inf
    delta_y = abs(1.0 / sin) if sin != 0.0 else np.inf
    next_x = ((col + 1 - x) if cos > 0.0 else (x - col)) * delta_x if cos != 0.0 else np.inf
    next_y = ((row + 1 - y) if sin > 0.0 else (y - row)) * delta_y if sin != 0.0 else np.inf
    while True:
        if next_x < next_y:
            distance = next_x
            next_x += delta_x
            col += step_x
            if col < 0 or col >= width:
                return np.inf, 0
        else:
            distance = next_y
            next_y += delta_y
            row += step_y
            if row < 0 or row >= height:
                return np.inf, 0
        if distance > max_range:
            return np.inf, 0
        if opaque[row, col] != 0:
            return distance, int(opaque[row, col])


@inline
def bresenham(opaque, x, y, cos, sin, max_range):
    """Range by Bresenham's line from the ray's cell to the cell at max_range: the report's way; to the cell's centre.

    Returns (range in cells, value of the cell that stopped it).
    """
    height, width = opaque.shape
    col, row = int(math.floor(x)), int(math.floor(y))
    start_col, start_row = col, row
    end_col, end_row = int(math.floor(x + max_range * cos)), int(math.floor(y + max_range * sin))
    d_col, d_row = abs(end_col - col), -abs(end_row - row)
    step_col = 1 if end_col > col else -1
    step_row = 1 if end_row > row else -1
    error = d_col + d_row
    while True:
        if col < 0 or row < 0 or col >= width or row >= height:
            return np.inf, 0
        if opaque[row, col] != 0:
            return math.hypot(col - start_col, row - start_row), int(opaque[row, col])
        if col == end_col and row == end_row:
            return np.inf, 0
        twice = 2 * error
        if twice >= d_row:
            error += d_row
            col += step_col
        if twice <= d_col:
            error += d_col
            row += step_row


@kernel
def cast(opaque, poses, angles, max_range, use_bresenham, out):
    """Ranges from single poses: poses (n, 3) float64 cells and radians, angles (k,) float64 -> out (n, k) float32."""
    for i in range(poses.shape[0]):
        for k in range(angles.shape[0]):
            a = poses[i, 2] + angles[k]
            if use_bresenham:
                out[i, k] = bresenham(opaque, poses[i, 0], poses[i, 1], math.cos(a), math.sin(a), max_range)[0]
            else:
                out[i, k] = dda(opaque, poses[i, 0], poses[i, 1], math.cos(a), math.sin(a), max_range)[0]


@paired
def cast_codes(opaque, x, y, theta, laser_x, laser_y, laser_yaw, angles, max_range, use_bresenham, scale, log_offset,
               hit_codes, unknown_codes, out):  # fmt: skip
    """Range codes by casting, for particles: the slow way to what the table holds.

    ``x, y, theta`` (n,) float32 poses of the robot, cells and radians; ``laser_*`` the laser on the robot, cells and
    radians; ``angles`` (k,) float64; codes as in ``encode`` -> ``out`` (n, k) uint8.
    """
    for i in prange(x.shape[0]):
        cos, sin = math.cos(theta[i]), math.sin(theta[i])
        at_x = x[i] + cos * laser_x - sin * laser_y
        at_y = y[i] + sin * laser_x + cos * laser_y
        for k in range(angles.shape[0]):
            a = theta[i] + laser_yaw + angles[k]
            if use_bresenham:
                distance, kind = bresenham(opaque, at_x, at_y, math.cos(a), math.sin(a), max_range)
            else:
                distance, kind = dda(opaque, at_x, at_y, math.cos(a), math.sin(a), max_range)
            out[i, k] = encode(distance, kind, scale, log_offset, hit_codes, unknown_codes)


@inline
def encode(distance, kind, scale, log_offset, hit_codes, unknown_codes):
    """A range in eight bits: log(1 + distance / log_offset), in ``hit_codes`` steps where an obstacle stopped the ray,
    in ``unknown_codes`` coarser ones above them where the map's knowledge ended, and 255 where nothing did."""
    if not distance < np.inf:
        return np.uint8(255)
    share = min(math.log1p(distance / log_offset) * scale, 1.0)
    if kind == OCCUPIED:
        return np.uint8(int(share * (hit_codes - 1) + 0.5))
    return np.uint8(hit_codes + int(share * (unknown_codes - 1) + 0.5))


OCCUPIED = 1
UNKNOWN = 2
