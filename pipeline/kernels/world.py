"""What poses see in the world as the log has shown it, where that is not what the table of the map says.

Lengths are in cells of a raster that is the map's and goes on around it by ``margin`` cells on every side.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.kernels import inline, kernel
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
def score(to_wall, to_known, turns, offsets, walls, known, likelihood, agnostic, survival, out):
    """Log-likelihood of each beam of a scan for poses whose rays pass unknown land -> ``out`` (n, k) float32.

    ``walls``, ``known`` (rows, headings + span) uint8: codes of the range to the first wall, and to the first cell that
    is known, in which ``to_wall``, ``to_known`` (n,) int64 are the poses' rows and ``turns`` (n,) int32 the headings of
    their first beams; ``likelihood`` (k, 256) float32 of a beam for each code of the one; ``agnostic`` (k, 256) for
    each code of the other, where the beam ended before it; ``survival`` (256,) float32: how probable it is to pass so
    much unknown land.
    """
    for i in range(turns.shape[0]):
        for k in range(offsets.shape[0]):
            at = turns[i] + offsets[k]
            first = known[to_known[i], at]
            density = agnostic[k, first] + survival[first] * likelihood[k, walls[to_wall[i], at]]
            out[i, k] = math.log(max(density, np.float32(1e-30)))


@inline
def count(cell, at, stamp, counts, others, most):
    """One more of ``counts`` in a cell, once a scan, with what is old scaled down where there are too many of both."""
    at[cell] = stamp
    counts[cell] += np.float32(1.0)
    total = counts[cell] + others[cell]
    if total > most:
        counts[cell] *= most / total
        others[cell] *= most / total


@kernel
def look(x, y, yaw, angles, ranges, longest, width, margin, stamp, passed_at, hit_at, passes, hits, most):
    """Count in which cells the beams of a scan passed, and in which they ended: each cell once a scan.

    ``x, y`` cells of the map, ``yaw`` rad: the laser's pose; ``angles`` (k,) rad, ``ranges`` (k,) float32 cells, beyond
    ``longest`` only passed, NaN nothing; ``stamp``: the scan's number, above 0; ``passed_at``, ``hit_at`` int32 flat:
    the last scan that counted there; ``passes``, ``hits`` float32 flat, together at most ``most``, so that what is new
    outweighs what is old. A beam that ends in a cell outweighs those that pass it in the same scan.
    """
    height = passes.shape[0] // width
    for part in range(2):
        for k in range(angles.shape[0]):
            if math.isnan(ranges[k]):
                continue
            cos, sin = math.cos(yaw + angles[k]), math.sin(yaw + angles[k])
            if part == 0 and ranges[k] <= longest:
                col = np.int64(math.floor(x + ranges[k] * cos)) + margin
                row = np.int64(math.floor(y + ranges[k] * sin)) + margin
                if 0 <= col < width and 0 <= row < height and hit_at[row * width + col] != stamp:
                    count(row * width + col, hit_at, stamp, hits, passes, most)
            if part == 1:
                # Not the last cell and a half: a wall seen at a slant is in the cell before its end, too.
                until = min(ranges[k] - np.float32(1.5), longest)
                steps = np.int64(until * 1.5)
                for s in range(steps):
                    col = np.int64(math.floor(x + s / 1.5 * cos)) + margin
                    row = np.int64(math.floor(y + s / 1.5 * sin)) + margin
                    if not (0 <= col < width and 0 <= row < height):
                        break
                    cell = row * width + col
                    if passed_at[cell] != stamp and hit_at[cell] != stamp:
                        count(cell, passed_at, stamp, passes, hits, most)
