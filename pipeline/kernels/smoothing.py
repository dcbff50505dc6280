"""Backward simulation: which past poses could have led to the present ones."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pipeline.kernels import inline, paired
from pipeline.kernels.random import uniform

NOWHERE = 80.0
"""Squared deviations from which on exp(-x / 2) < 1e-17 counts as zero."""


@inline
def _wrapped(angle):
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@paired
def draw_predecessors(x, y, theta, weights, at, which, moved, std, jump, key, chosen):
    """For each trajectory j at its pose ``at[which[j]]``, draw the particle one update earlier that it came from.

    ``at`` (u, 3) poses and ``which`` (m,) int64: trajectories run together, and what is the same is worked out once.

    ``x, y, theta`` (n,) float32 particles and their ``weights`` (n,) float32; ``moved`` (3,): dx, dy, dtheta of the
    odometry as seen from the earlier pose; ``std`` (3,): deviations along, across and in heading; ``jump``: density of
    coming from anywhere, as a kidnapped robot does, relative to the peak -> ``chosen`` (m,) int32.
    """
    n = x.shape[0]
    cos, sin = np.cos(theta), np.sin(theta)
    # Most particles are farther away than any noise reaches, which is seen without turning into their frame: the
    # exponential is nothing beside the jump.
    reach = math.hypot(moved[0], moved[1]) + math.sqrt(NOWHERE) * max(std[0], std[1])
    for u in prange(at.shape[0]):
        density = np.empty(n)
        total = 0.0
        for i in range(n):
            dx, dy = at[u, 0] - x[i], at[u, 1] - y[i]
            likely = jump
            if dx * dx + dy * dy < reach * reach:
                along = (cos[i] * dx + sin[i] * dy - moved[0]) / std[0]
                across = (-sin[i] * dx + cos[i] * dy - moved[1]) / std[1]
                turn = _wrapped(at[u, 2] - theta[i] - moved[2]) / std[2]
                far = along * along + across * across + turn * turn
                if far < NOWHERE:
                    likely += math.exp(-0.5 * far)
            density[i] = weights[i] * likely
            total += density[i]
        for j in range(which.shape[0]):
            if which[j] != u:
                continue
            target = uniform(key, j) * total
            i = 0
            cumulative = density[0]
            while cumulative < target and i < n - 1:
                i += 1
                cumulative += density[i]
            chosen[j] = i
