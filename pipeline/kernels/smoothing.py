"""Backward simulation: which past poses could have led to the present ones."""

from __future__ import annotations

import numpy as np
from numba import prange

from pipeline.kernels import inline, paired
from pipeline.kernels.elementary import exponential, sine_cosine, sum_of, wrapped
from pipeline.kernels.random import uniform

STRETCH = 64
"""Particles whose densities are added up before it is asked where a draw falls."""


@inline
def add_densities(x, y, theta, cos, sin, weights, at, moved, scale, share, jump, out):
    """How likely each particle led to the pose ``at`` (3,) by the move: a Gaussian in its own frame, or a jump.

    ``moved`` (3,) float32, ``scale`` (3,) float32 inverse deviations; ``jump``: of a jump -> added to ``out`` (n,)
    float32, ``share`` times. No branches.
    """
    at_x, at_y, at_yaw = np.float32(at[0]), np.float32(at[1]), np.float32(at[2]) - moved[2]
    for i in range(x.shape[0]):
        dx, dy = at_x - x[i], at_y - y[i]
        along = (cos[i] * dx + sin[i] * dy - moved[0]) * scale[0]
        across = (cos[i] * dy - sin[i] * dx - moved[1]) * scale[1]
        turn = wrapped(at_yaw - theta[i]) * scale[2]
        far = along * along + across * across + turn * turn
        out[i] += share * (weights[i] * (jump + exponential(np.float32(-0.5) * far)))


@paired
def draw_predecessors(x, y, theta, weights, at, which, moved, std, shares, jump, key, chosen):
    """For each trajectory j at its pose ``at[which[j]]``, draw the particle one update earlier that it came from.

    ``at`` (u, 3) poses and ``which`` (m,) int64: trajectories run together, and what is the same is worked out once.

    ``x, y, theta`` (n,) float32 particles and their ``weights`` (n,) float32; ``moved`` (c, 3): dx, dy, dtheta as each
    witness tells, seen from the earlier pose; ``std`` (c, 3): deviations along, across and in heading; ``shares`` (c,)
    of belief in each; ``jump``: density of coming from anywhere, as a kidnapped robot does, relative to the peak ->
    ``chosen`` (m,) int32.
    """
    n = x.shape[0]
    cos, sin = np.empty(n, np.float32), np.empty(n, np.float32)
    for i in range(n):
        sin[i], cos[i] = sine_cosine(theta[i])
    way, scale = moved.astype(np.float32), (1.0 / std).astype(np.float32)
    share = shares.astype(np.float32)
    stretches = (n + STRETCH - 1) // STRETCH
    for u in prange(at.shape[0]):
        density, upto = np.empty(n, np.float32), np.empty(stretches + 1)
        density[:] = np.float32(0.0)
        for c in range(way.shape[0]):
            add_densities(x, y, theta, cos, sin, weights, at[u], way[c], scale[c], share[c], np.float32(jump), density)
        upto[0] = 0.0
        for s in range(stretches):
            upto[s + 1] = upto[s] + sum_of(density, s * STRETCH, min((s + 1) * STRETCH, n))
        for j in range(which.shape[0]):
            if which[j] != u:
                continue
            target = uniform(key, j) * upto[stretches]
            s = 0
            while upto[s + 1] <= target and s < stretches - 1:
                s += 1
            i, end = s * STRETCH, min((s + 1) * STRETCH, n)
            cumulative = upto[s] + density[i]
            while cumulative <= target and i < end - 1:
                i += 1
                cumulative += density[i]
            chosen[j] = i
