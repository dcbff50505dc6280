"""Weights, and sums over particles.

Sums run over fixed blocks of particles, and the blocks are added in order: the result does not depend on the number
of threads.
"""

from __future__ import annotations

import math

from numba import prange

from pipeline.kernels import BLOCK, paired

LEAST = -1e300
"""Below any logarithm of a weight that is not zero."""


@paired
def weigh(log_weights, log_likelihood, temper, weights, largest, sums):
    """log_weights += temper * log_likelihood, in place and then normalised; ``weights`` are their exponentials.

    ``log_weights`` (n,) float64, ``log_likelihood`` (n,) float32; ``largest`` (blocks,) and ``sums`` (blocks, 2)
    float64 to work in. Returns the logarithm of the weights' sum before it was made one, and the effective sample size.
    """
    n = log_weights.shape[0]
    for b in prange(largest.shape[0]):
        top, total, squares = LEAST, 0.0, 0.0
        for i in range(b * BLOCK, min((b + 1) * BLOCK, n)):
            log_weights[i] += temper * log_likelihood[i]
            top = max(top, log_weights[i])
        for i in range(b * BLOCK, min((b + 1) * BLOCK, n)):
            w = math.exp(log_weights[i] - top)
            weights[i] = w
            total += w
            squares += w * w
        largest[b], sums[b, 0], sums[b, 1] = top, total, squares
    top, total, squares = largest.max(), 0.0, 0.0
    for b in range(largest.shape[0]):
        share = math.exp(largest[b] - top)
        total += share * sums[b, 0]
        squares += share * share * sums[b, 1]
    log_total = top + math.log(total)
    for b in prange(largest.shape[0]):
        factor = math.exp(largest[b] - log_total)
        for i in range(b * BLOCK, min((b + 1) * BLOCK, n)):
            log_weights[i] -= log_total
            weights[i] *= factor
    return log_total, total * total / squares


@paired
def weighted_sum(values, weights, sums):
    """Blocks' sums of weights * values: values (n,) float32, weights (n,) float64 -> ``sums`` (blocks,) float64."""
    n = values.shape[0]
    for b in prange(sums.shape[0]):
        total = 0.0
        for i in range(b * BLOCK, min((b + 1) * BLOCK, n)):
            total += weights[i] * values[i]
        sums[b] = total


@paired
def to_map(x, y, theta, origin_x, origin_y, origin_yaw, out):
    """Poses from the grid frame to the map frame: (n,) float32 each -> ``out`` (n, 3) float32."""
    cos, sin = math.cos(origin_yaw), math.sin(origin_yaw)
    for i in prange(x.shape[0]):
        out[i, 0] = origin_x + cos * x[i] - sin * y[i]
        out[i, 1] = origin_y + sin * x[i] + cos * y[i]
        turn = theta[i] + origin_yaw
        if turn >= math.pi:
            turn -= 2.0 * math.pi
        elif turn < -math.pi:
            turn += 2.0 * math.pi
        out[i, 2] = turn


@paired
def squared_distance(x, y, at_x, at_y, weights, sums):
    """Blocks' sums of weights * squared distance from (at_x, at_y) -> ``sums`` (blocks,) float64."""
    n = x.shape[0]
    for b in prange(sums.shape[0]):
        total = 0.0
        for i in range(b * BLOCK, min((b + 1) * BLOCK, n)):
            total += weights[i] * ((x[i] - at_x) ** 2 + (y[i] - at_y) ** 2)
        sums[b] = total
