"""Sums over particles, and the cells of a coarse grid that they occupy.

Sums run over fixed blocks of particles, and the blocks are added in order: the result does not depend on the number
of threads.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pipeline.kernels import inline, kernel, paired

BLOCK = 4096


@paired
def add_likelihood(log_weights, log_likelihood, temper, block_max):
    """log_weights += temper * log_likelihood, in place; ``block_max`` (blocks,) float64 gets the blocks' maxima."""
    n = log_weights.shape[0]
    for b in prange(block_max.shape[0]):
        largest = -np.inf
        for i in range(b * BLOCK, min((b + 1) * BLOCK, n)):
            log_weights[i] += temper * log_likelihood[i]
            largest = max(largest, log_weights[i])
        block_max[b] = largest


@paired
def exponentiate(log_weights, largest, weights, sums):
    """weights = exp(log_weights - largest); ``sums`` (blocks, 2) float64 gets the blocks' sums of w and w squared."""
    n = log_weights.shape[0]
    for b in prange(sums.shape[0]):
        total = 0.0
        squares = 0.0
        for i in range(b * BLOCK, min((b + 1) * BLOCK, n)):
            w = math.exp(log_weights[i] - largest)
            weights[i] = w
            total += w
            squares += w * w
        sums[b, 0] = total
        sums[b, 1] = squares


@paired
def rescale(log_weights, weights, log_total, factor, blocks):
    """Normalise in place: log_weights -= log_total, weights *= factor."""
    n = log_weights.shape[0]
    for b in prange(blocks):
        for i in range(b * BLOCK, min((b + 1) * BLOCK, n)):
            log_weights[i] -= log_total
            weights[i] *= factor


@paired
def weighted_sum(values, weights, sums):
    """Blocks' sums of weights * values: values (n,) float32, weights (n,) float64 -> ``sums`` (blocks,) float64."""
    n = values.shape[0]
    for b in prange(sums.shape[0]):
        total = 0.0
        for i in range(b * BLOCK, min((b + 1) * BLOCK, n)):
            total += weights[i] * values[i]
        sums[b] = total


@inline
def _slot(key, keys, mask):
    """Where a key is, or would be put, in an open-addressed table whose empty places hold -1."""
    place = (np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(32)
    slot = np.int64(place) & mask
    while keys[slot] != -1 and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot


@kernel
def occupied_bins(x, y, theta, weights, size, turns, keys, bin_at, bin_of, bin_key, bin_weight):
    """Which cells of a coarse grid the particles occupy, and with what weight: counts for KLD-sampling, and clusters.

    ``size``: edge of a bin in m; ``turns``: bins in a full turn of heading; ``keys``, ``bin_at`` (power of two > n,)
    int64 and int32: hash table to work in -> ``bin_of`` (n,) int32 bin of each particle, ``bin_key`` and
    ``bin_weight`` (n,) of each bin. Returns the number of occupied bins.
    """
    mask = keys.shape[0] - 1
    keys[:] = -1
    bins = 0
    last, at = np.int64(-1), np.int32(0)
    for i in range(x.shape[0]):
        turn = np.int64(math.floor((theta[i] + math.pi) / (2.0 * math.pi) * turns))
        if turn < 0 or turn >= turns:  # a division takes longer than all the rest
            turn %= turns
        key = bin_number(np.int64(math.floor(x[i] / size)), np.int64(math.floor(y[i] / size)), turn, turns)
        if key != last:  # survivors of one particle lie side by side
            last = key
            slot = _slot(key, keys, mask)
            if keys[slot] == -1:
                keys[slot] = key
                bin_at[slot] = bins
                bin_key[bins] = key
                bin_weight[bins] = 0.0
                bins += 1
            at = bin_at[slot]
        bin_of[i] = at
        bin_weight[at] += weights[i]
    return bins


_SPAN = 1 << 20
_HALF = 1 << 19


@inline
def bin_number(col, row, turn, turns):
    """One number for a bin; columns and rows within half a million of the origin."""
    return ((row + _HALF) * _SPAN + col + _HALF) * turns + turn


@kernel
def label_bins(bins, turns, keys, bin_at, bin_key, bin_weight, floor, parent):
    """Joins neighbouring bins (of 26) of at least ``floor`` weight into clusters, by union-find.

    -> ``parent`` (bins,) int32: the root bin of each bin's cluster, -1 for bins that are too light.
    """
    mask = keys.shape[0] - 1
    for b in range(bins):
        parent[b] = b if bin_weight[b] >= floor else -1
    for b in range(bins):
        if parent[b] < 0:
            continue
        turn = bin_key[b] % turns
        place = bin_key[b] // turns
        for d_turn in range(-1, 2):
            other_turn = (turn + d_turn) % turns
            for d_row in range(-1, 2):
                for d_col in range(-1, 2):
                    key = (place + d_row * _SPAN + d_col) * turns + other_turn
                    slot = _slot(key, keys, mask)
                    if keys[slot] == -1 or parent[bin_at[slot]] < 0:
                        continue
                    a, c = b, bin_at[slot]
                    while parent[a] != a:
                        a = parent[a]
                    while parent[c] != c:
                        c = parent[c]
                    if a != c:
                        parent[max(a, c)] = min(a, c)
    for b in range(bins):
        if parent[b] >= 0:
            root = b
            while parent[root] != root:
                root = parent[root]
            parent[b] = root


@kernel
def cluster_moments(x, y, theta, weights, bin_of, parent, slot_of_root, sums):
    """First and second moments of each cluster, about its first particle so that nothing cancels.

    ``slot_of_root`` (bins,) int32: row of a root bin in ``sums``, or -1. ``sums`` (clusters, 16) float64, zero at the
    start: [0] weight; [1..3] anchor x, y, theta; [4..6] sums of w * (dx, dy, dtheta); [7..12] sums of
    w * (xx, xy, xt, yy, yt, tt); [13] is 1 once there is an anchor.
    """
    for i in range(x.shape[0]):
        root = parent[bin_of[i]]
        if root < 0 or slot_of_root[root] < 0:
            continue
        s = sums[slot_of_root[root]]
        if s[13] == 0.0:
            s[13] = 1.0
            s[1], s[2], s[3] = x[i], y[i], theta[i]
        w = weights[i]
        dx, dy, dt = x[i] - s[1], y[i] - s[2], theta[i] - s[3]
        if dt >= math.pi:
            dt -= 2.0 * math.pi
        elif dt < -math.pi:
            dt += 2.0 * math.pi
        s[0] += w
        s[4] += w * dx
        s[5] += w * dy
        s[6] += w * dt
        s[7] += w * dx * dx
        s[8] += w * dx * dy
        s[9] += w * dx * dt
        s[10] += w * dy * dy
        s[11] += w * dy * dt
        s[12] += w * dt * dt


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
