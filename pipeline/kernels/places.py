"""Small beliefs side by side, one for each place: a row of particles each."""

from __future__ import annotations

import math

from pipeline.kernels import kernel

LEAST = 1e-300
"""A particle's weight never becomes nothing: it may be all that is left."""


@kernel
def weigh(weights, log_likelihood, temper, ess):
    """weights *= exp(temper * log_likelihood), each row normalised; both (m, n), float64 and float32.

    -> ``ess`` (m,) float64: the effective sample size of each row.
    """
    m, n = weights.shape
    for row in range(m):
        largest = log_likelihood[row].max()
        total, squares = 0.0, 0.0
        for i in range(n):
            w = max(weights[row, i] * math.exp(temper * (log_likelihood[row, i] - largest)), LEAST)
            weights[row, i] = w
            total += w
            squares += w * w
        ess[row] = total * total / squares
        for i in range(n):
            weights[row, i] /= total


@kernel
def mean_poses(x, y, theta, weights, out):
    """Weighted means of the rows: (m, n) float32 m, m, rad and float64 weights -> ``out`` (m, 3) float64."""
    m, n = weights.shape
    for row in range(m):
        sum_x, sum_y, cos, sin = 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            w, angle = weights[row, i], float(theta[row, i])
            sum_x += w * x[row, i]
            sum_y += w * y[row, i]
            cos += w * math.cos(angle)
            sin += w * math.sin(angle)
        out[row, 0], out[row, 1], out[row, 2] = sum_x, sum_y, math.atan2(sin, cos)
