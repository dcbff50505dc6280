"""How well poses explain a scan, read from a field of distances where its beams end.

Poses are (n,) float32 m, m, rad in the grid frame; ``ends_x, ends_y`` (k,) float32 cells say where each beam ends, seen
from the robot; ``inv_resolution`` float32 cells per metre. ``codes`` (height, width) uint16 stand for distances to the
nearest obstacle, and ``values`` (m,) float32 holds what each of them is worth, its last entry what an end outside the
map is worth. A beam costs a turn, two look-ups and an add.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pipeline.kernels import BLOCK, inline, paired


@inline
def field_code(x, y, cos, sin, end_x, end_y, codes, nowhere):
    """The code of the cell in which a beam ends; ``nowhere`` outside the map, and for what is no number."""
    height, width = codes.shape
    fx = x + cos * end_x - sin * end_y
    fy = y + sin * end_x + cos * end_y
    if not (fx >= np.float32(0.0) and fy >= np.float32(0.0) and fx < np.float32(width) and fy < np.float32(height)):
        return nowhere
    return np.int32(codes[np.int32(fy), np.int32(fx)])


@paired
def score_field(x, y, theta, ends_x, ends_y, inv_resolution, codes, values, out):
    """The sum over beams of what their ends are worth, at every particle -> ``out`` (n,) float32."""
    nowhere = np.int32(values.shape[0] - 1)
    for i in prange(x.shape[0]):
        at_x, at_y = x[i] * inv_resolution, y[i] * inv_resolution
        cos, sin = np.float32(math.cos(theta[i])), np.float32(math.sin(theta[i]))
        total = np.float32(0.0)
        for k in range(ends_x.shape[0]):
            total += values[field_code(at_x, at_y, cos, sin, ends_x[k], ends_y[k], codes, nowhere)]
        out[i] = total


@paired
def count_near(x, y, theta, ends_x, ends_y, inv_resolution, codes, near, counts):
    """For each beam the particles at which it ends on the map, in a cell whose code is below ``near``.

    ``counts`` (blocks of BLOCK particles, k) int64: of every block on its own, so that any number of threads may count.
    """
    n = x.shape[0]
    for b in prange(counts.shape[0]):
        counts[b] = 0
        for i in range(b * BLOCK, min((b + 1) * BLOCK, n)):
            at_x, at_y = x[i] * inv_resolution, y[i] * inv_resolution
            cos, sin = np.float32(math.cos(theta[i])), np.float32(math.sin(theta[i]))
            for k in range(ends_x.shape[0]):
                code = field_code(at_x, at_y, cos, sin, ends_x[k], ends_y[k], codes, np.int32(-1))
                counts[b, k] += 0 <= code < near
