"""Moving the particles: each follows one of the ways in which the robot may have moved (Table 5.6, or a Gaussian)."""

from __future__ import annotations

import numpy as np
from numba import prange

from pipeline.kernels import BLOCK, kernel, paired
from pipeline.kernels.elementary import sine_cosine, wrapped
from pipeline.kernels.random import random_bits

SHARES = 256
"""The ways are chosen among by eight random bits."""
_LOW16 = np.uint64(0xFFFF)
_S16, _S32, _S56 = np.uint64(16), np.uint64(32), np.uint64(56)


@kernel
def followed(weights, way_of, key, out):
    """``out`` (k,): how much of the ``weights`` (n,) belongs to the particles that took each way of ``move``; the same
    ``way_of`` and ``key``."""
    out[:] = 0.0
    for i in range(weights.shape[0]):
        out[way_of[random_bits(key, i) >> _S56]] += weights[i]


@kernel
def taken(way_of, key, out):
    """``out`` (n,) int32: the way that each particle takes in ``move``; the same ``way_of`` and ``key``."""
    for i in range(out.shape[0]):
        out[i] = way_of[random_bits(key, i) >> _S56]


@paired
def move(x, y, theta, ways, way_of, key, quantiles):
    """Each particle turns, drives along and across, and turns again, with Gaussian noise of its own; in place.

    ``x, y, theta`` (n,) float32, grid frame (m, rad). ``ways`` (k, 12) float32, a row for each way to move: first turn
    and its deviation; drive along, and what the first and second normal add to it; the same across; second turn,
    and what all three add to it. ``way_of`` (256,) int32: which row a particle takes for its eight random bits.
    ``key`` of the random stream; ``quantiles`` (65536,) float32 of the standard normal. theta stays in [-pi, pi).
    """
    n = x.shape[0]
    table = ways.reshape(-1)
    for b in prange((n + BLOCK - 1) // BLOCK):
        first, last = b * BLOCK, min((b + 1) * BLOCK, n)
        # No branches, so that several particles are moved by each instruction.
        for i in range(first, last):
            bits = random_bits(key, i)
            at = np.uint64(12) * np.uint64(way_of[bits >> _S56])
            one, two = quantiles[bits & _LOW16], quantiles[(bits >> _S16) & _LOW16]
            three = quantiles[(bits >> _S32) & _LOW16]
            turn = theta[i] + (table[at] + table[at + np.uint64(1)] * one)
            along = table[at + np.uint64(2)] + table[at + np.uint64(4)] * two
            along += table[at + np.uint64(3)] * one
            across = table[at + np.uint64(5)] + table[at + np.uint64(6)] * one + table[at + np.uint64(7)] * two
            again = table[at + np.uint64(8)] + table[at + np.uint64(11)] * three
            again += table[at + np.uint64(9)] * one + table[at + np.uint64(10)] * two
            heading = turn + again
            sine, cosine = sine_cosine(turn)
            x[i] = (x[i] + along * cosine) - across * sine
            y[i] = (y[i] + along * sine) + across * cosine
            theta[i] = wrapped(heading)
