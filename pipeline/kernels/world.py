"""What poses see in the world as the log has shown it, where that is not what the table of the map says.

Lengths are in cells of a raster that is the map's and goes on around it by ``margin`` cells on every side.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.kernels import kernel
from pipeline.kernels.elementary import sine_cosine


@kernel
def find(x, y, theta, laser_x, laser_y, laser_yaw, inv_resolution, headings, margin, wanted, which, cells, turns):
    """Of each pose whose laser is in a cell that is ``wanted``, or off the raster, its index, cell and heading.

    ``wanted`` (height, width) bool; everything else as ``scoring.table_place`` has it -> ``which``, ``cells`` (n,)
    int64, -1 off the raster, ``turns`` (n,) int32; returns how many there are.
    """
    height, width = wanted.shape
    found = 0
    for i in range(x.shape[0]):
        sine, cosine = sine_cosine(theta[i])
        col = np.int64(math.floor((x[i] + cosine * laser_x - sine * laser_y) * inv_resolution)) + margin
        row = np.int64(math.floor((y[i] + sine * laser_x + cosine * laser_y) * inv_resolution)) + margin
        on = (col >= 0) & (row >= 0) & (col < width) & (row < height)
        if on and not wanted[row, col]:
            continue
        turn = np.floor((theta[i] + laser_yaw) * np.float32(headings / (2.0 * math.pi)) + np.float32(0.5))
        which[found], cells[found] = i, row * width + col if on else -1
        turns[found] = np.int32(turn - np.float32(headings) * np.floor(turn / np.float32(headings)))
        found += 1
    return found


@kernel
def walled(which, from_x, from_y, to_x, to_y, inv_resolution, margin, kinds, wall, out):
    """Whether the straight way of each of the poses ``which`` (m,) leads through a cell of the kind ``wall``.

    ``from_x`` ... ``to_y`` (n,) float32 m -> ``out`` (m,) bool. Looked at in steps of at most half a cell.
    """
    height, width = kinds.shape
    for j in range(which.shape[0]):
        i = which[j]
        dx, dy = (to_x[i] - from_x[i]) * inv_resolution, (to_y[i] - from_y[i]) * inv_resolution
        steps = np.int64(2.0 * math.hypot(dx, dy)) + 1
        out[j] = False
        for s in range(steps + 1):
            col = np.int64(math.floor(from_x[i] * inv_resolution + dx * s / steps)) + margin
            row = np.int64(math.floor(from_y[i] * inv_resolution + dy * s / steps)) + margin
            if 0 <= col < width and 0 <= row < height and kinds[row, col] == wall:
                out[j] = True
                break


@kernel
def score(rows, turns, offsets, by_map, known_from, likelihood, agnostic, survival, out):
    """Log-likelihood of each beam of a scan for poses whose rays pass unknown land -> ``out`` (n, k) float32.

    ``rows`` (n,) int64 into the tables; ``turns`` (n,) int32 heading of the laser's first beam; ``by_map`` and
    ``known_from`` (m, headings + span) uint8: codes of the range to the first mapped wall, and to the first cell that
    is known; ``likelihood`` (k, 256) float32 of a beam for each code of the first; ``agnostic`` (k, 256) for each code
    of the second, where the beam ended before it; ``survival`` (256,) float32: how probable it is to pass so much
    unknown land.
    """
    for i in range(rows.shape[0]):
        for k in range(offsets.shape[0]):
            at = turns[i] + offsets[k]
            first = known_from[rows[i], at]
            density = agnostic[k, first] + survival[first] * likelihood[k, by_map[rows[i], at]]
            out[i, k] = math.log(max(density, np.float32(1e-30)))
