"""Moving the particles (Probabilistic Robotics, Table 5.6)."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pipeline.kernels import paired
from pipeline.kernels.random import random_bits

_LOW16 = np.uint64(0xFFFF)
_S16, _S32 = np.uint64(16), np.uint64(32)
_HALF_TURN = np.float32(math.pi)


@paired
def move(x, y, theta, rot1, trans, rot2, std1, std_t, std2, key, quantiles, drives):
    """Each particle turns by rot1, drives trans, turns by rot2, each with Gaussian noise of its own; in place.

    ``x, y, theta`` (n,) float32, grid frame (m, rad); ``rot*``, ``trans`` and their standard deviations in rad and m;
    ``key`` of the random stream; ``quantiles`` (65536,) float32 of the standard normal, ``drives`` (65536,) of the
    noise of trans. theta stays in [-pi, pi).
    """
    for i in prange(x.shape[0]):
        bits = random_bits(key, i)
        turn = theta[i] + np.float32(rot1 + std1 * quantiles[bits & _LOW16])
        drive = np.float32(trans + std_t * drives[(bits >> _S16) & _LOW16])
        heading = turn + np.float32(rot2 + std2 * quantiles[(bits >> _S32) & _LOW16])
        x[i] += drive * np.float32(math.cos(turn))
        y[i] += drive * np.float32(math.sin(turn))
        if heading >= _HALF_TURN or heading < -_HALF_TURN:
            # As many turns as it takes: wide noise needs more than one. In double, since there may be many.
            within = heading - 2.0 * math.pi * np.floor((heading + math.pi) / (2.0 * math.pi))
            heading = np.float32(within)
            if heading >= _HALF_TURN:  # rounded up to the border
                heading = -_HALF_TURN
        theta[i] = heading
