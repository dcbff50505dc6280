"""How well poses explain a scan, read from the table of pre-computed ranges.

``rows`` (n, headings + span) uint8 holds one row per open cell: the code of the true range in every heading, the first
``span`` headings repeated at the end so that no index needs a modulo. ``log_likelihood`` (k, 256) float32 holds one
row per beam of the scan at hand: log p(z | z*) for every code of z*. A beam then costs two look-ups and an add.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pipeline.kernels import inline, kernel, paired


@inline
def table_place(x, y, theta, laser_x, laser_y, laser_yaw, inv_resolution, headings, row_of_cell):
    """Where a robot pose (m, rad, grid frame) looks into the table: (row or -1, heading of the laser)."""
    height, width = row_of_cell.shape
    cos, sin = np.float32(math.cos(theta)), np.float32(math.sin(theta))
    fx = (x + cos * laser_x - sin * laser_y) * inv_resolution
    fy = (y + sin * laser_x + cos * laser_y) * inv_resolution
    if not (fx >= np.float32(0.0) and fy >= np.float32(0.0) and fx < np.float32(width) and fy < np.float32(height)):
        return np.int32(-1), np.int32(0)
    turn = (theta + laser_yaw) * np.float32(headings / (2.0 * math.pi)) + np.float32(headings + 0.5)
    heading = np.int32(turn) % np.int32(headings)
    return row_of_cell[np.int32(fy), np.int32(fx)], heading


@paired
def score(x, y, theta, laser_x, laser_y, laser_yaw, inv_resolution, headings, row_of_cell, rows, offsets,
          log_likelihood, outside, out):  # fmt: skip
    """Log-likelihood of the scan at every particle.

    ``x, y, theta`` (n,) float32 m, m, rad, grid frame; ``laser_*`` float32 m, rad on the robot; ``row_of_cell``
    (height, width) int32, -1 where no laser can be; ``offsets`` (k,) int32 heading of each beam relative to the
    laser's; ``outside``: log-likelihood of a pose in a wall or off the map -> ``out`` (n,) float32.
    """
    beams = offsets.shape[0]
    for i in prange(x.shape[0]):
        row, heading = table_place(
            x[i], y[i], theta[i], laser_x, laser_y, laser_yaw, inv_resolution, headings, row_of_cell
        )
        if row < 0:
            out[i] = outside
            continue
        total = np.float32(0.0)
        for k in range(beams):
            total += log_likelihood[k, rows[row, heading + offsets[k]]]
        out[i] = total


@paired
def score_codes(codes, log_likelihood, outside, out):
    """Log-likelihood of the scan from codes (n, k) uint8 that were cast one by one -> ``out`` (n,) float32.

    A laser inside an obstacle sees nothing but zeros (code 0): it scores ``outside``, as in the table.
    """
    for i in prange(codes.shape[0]):
        total = np.float32(0.0)
        inside = False
        for k in range(codes.shape[1]):
            total += log_likelihood[k, codes[i, k]]
            inside |= codes[i, k] != 0
        out[i] = total if inside else outside


@kernel
def look_up(x, y, theta, laser_x, laser_y, laser_yaw, inv_resolution, headings, row_of_cell, rows, offsets, out):
    """The codes that ``score`` reads for every pose -> ``out`` (n, k) uint8, left alone in a wall or off the map."""
    for i in range(x.shape[0]):
        row, heading = table_place(
            x[i], y[i], theta[i], laser_x, laser_y, laser_yaw, inv_resolution, headings, row_of_cell
        )
        if row >= 0:
            for k in range(offsets.shape[0]):
                out[i, k] = rows[row, heading + offsets[k]]
