"""Moving the particles (Probabilistic Robotics, Table 5.6)."""

from __future__ import annotations

import numpy as np
from numba import prange

from pipeline.kernels import BLOCK, inline, paired
from pipeline.kernels.elementary import sine_cosine, wrapped
from pipeline.kernels.random import random_bits

_LOW16 = np.uint64(0xFFFF)
_S16, _S32 = np.uint64(16), np.uint64(32)


@inline
def move_some(x, y, theta, first, last, rot1, trans, rot2, std1, std_t, std2, key, quantiles, drives):
    """``move`` for the particles ``first`` to ``last``: no branches, so that several are moved by each instruction."""
    turn1, drive, turn2 = np.float32(rot1), np.float32(trans), np.float32(rot2)
    wide1, wide_t, wide2 = np.float32(std1), np.float32(std_t), np.float32(std2)
    for i in range(first, last):
        bits = random_bits(key, i)
        turn = theta[i] + (turn1 + wide1 * quantiles[bits & _LOW16])
        way = drive + wide_t * drives[(bits >> _S16) & _LOW16]
        heading = turn + (turn2 + wide2 * quantiles[(bits >> _S32) & _LOW16])
        sine, cosine = sine_cosine(turn)
        x[i] += way * cosine
        y[i] += way * sine
        theta[i] = wrapped(heading)


@paired
def move(x, y, theta, rot1, trans, rot2, std1, std_t, std2, key, quantiles, drives):
    """Each particle turns by rot1, drives trans, turns by rot2, each with Gaussian noise of its own; in place.

    ``x, y, theta`` (n,) float32, grid frame (m, rad); ``rot*``, ``trans`` and their standard deviations in rad and m;
    ``key`` of the random stream; ``quantiles`` (65536,) float32 of the standard normal, ``drives`` (65536,) of the
    noise of trans. theta stays in [-pi, pi).
    """
    n = x.shape[0]
    for b in prange((n + BLOCK - 1) // BLOCK):
        first, last = b * BLOCK, min((b + 1) * BLOCK, n)
        move_some(x, y, theta, first, last, rot1, trans, rot2, std1, std_t, std2, key, quantiles, drives)
