"""The hypotheses in a cloud of particles: the cells of a coarse grid that it occupies, joined where they touch.

The occupied cells (bins) are numbered in the order in which particles come upon them, and found by an open-addressed
hash table: ``table`` (power of two, 2) int64 holds the key of the bin in each slot, -1 where there is none, and its
number.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.kernels import BLOCK, inline, kernel
from pipeline.kernels.memory import prefetch

_SPAN, _HALF = 1 << 20, 1 << 19
_STIR = np.uint64(0x9E3779B97F4A7C15)
_AHEAD = 16
MOST = 8
"""Clusters that are told apart; there is no end to small ones."""
MOMENTS = 14
"""Sums of a cluster: w; its anchor x, y, theta; w * (dx, dy, dt); w * (xx, xy, xt, yy, yt, tt); whether anchored."""


@inline
def bin_key(col, row, turn, turns):
    """One number for a bin; columns and rows within half a million of the origin."""
    return ((row + _HALF) * _SPAN + col + _HALF) * turns + turn


@inline
def home(key, mask):
    """The slot at which the search for a bin begins."""
    return np.int64((np.uint64(key) * _STIR) >> np.uint64(32)) & mask


@inline
def slot_of(key, table, mask):
    """Where a bin is, or would be put."""
    slot = home(key, mask)
    while table[slot, 0] != -1 and table[slot, 0] != key:
        slot = (slot + 1) & mask
    return slot


@kernel
def occupied_bins(x, y, theta, weights, size, turns, table, bin_of, keys, bin_weights):
    """Which bins the particles occupy, and with what weight: counts for KLD-sampling, and clusters.

    ``x, y, theta`` (n,) float32 and ``weights`` (n,) float64; ``size``: edge of a bin in m; ``turns``: bins in a full
    turn of heading -> ``bin_of`` (n,) int32 bin of each particle, ``keys`` int64 and ``bin_weights`` float64 (n,) of
    each bin. Returns the number of bins; -1 if the table is too small, which it is when half full.
    """
    n, mask, flat = x.shape[0], table.shape[0] - 1, table.reshape(-1)
    table[:, 0] = -1
    bins, most = 0, table.shape[0] // 2
    coming = np.empty(BLOCK, np.int64)
    last, at = np.int64(-1), np.int64(0)
    for begin in range(0, n, BLOCK):
        end = min(begin + BLOCK, n)
        for i in range(begin, end):
            turn = np.int64(math.floor((theta[i] + math.pi) / (2.0 * math.pi) * turns))
            # A heading of pi may be rounded to either side.
            turn = turn - turns if turn >= turns else (turn + turns if turn < 0 else turn)
            col, row = np.int64(math.floor(x[i] / size)), np.int64(math.floor(y[i] / size))
            coming[i - begin] = bin_key(col, row, turn, turns)
        for i in range(begin, end):
            # Which slot comes next cannot be foretold, but it can be asked for.
            prefetch(flat, 2 * home(coming[min(i + _AHEAD, end - 1) - begin], mask))
            key = coming[i - begin]
            if key != last:  # survivors of one particle lie side by side
                last = key
                slot = slot_of(key, table, mask)
                if table[slot, 0] == -1:
                    if bins == most:
                        return -1
                    table[slot, 0], table[slot, 1] = key, bins
                    keys[bins], bin_weights[bins] = key, 0.0
                    bins += 1
                at = table[slot, 1]
            bin_of[i] = at
            bin_weights[at] += weights[i]
    return bins


@kernel
def join_bins(turns, table, keys, bin_weights, lightest, heavy, parent):
    """Joins neighbouring bins (of 26) of at least ``lightest`` times the heaviest one's weight, by union-find.

    Lighter ones are haze, which must not connect two places. ``keys`` and ``bin_weights`` (bins,) -> ``parent`` (bins,)
    int32: the bin that names each bin's cluster, -1 for haze; ``heavy`` (bins,) int32: those that are none. Returns how
    many these are.
    """
    mask, heaviest, m = table.shape[0] - 1, 0.0, 0
    for b in range(keys.shape[0]):
        heaviest = max(heaviest, bin_weights[b])
    for b in range(keys.shape[0]):
        parent[b] = -1
        if bin_weights[b] >= lightest * heaviest:
            parent[b], heavy[m] = b, b
            m += 1
    for b in heavy[:m]:
        turn, place = keys[b] % turns, keys[b] // turns
        for d in range(13):  # the other half of the neighbours find this one
            d_turn, d_row, d_col = d // 9 - 1, d // 3 % 3 - 1, d % 3 - 1
            key = (place + d_row * _SPAN + d_col) * turns + (turn + d_turn) % turns
            slot = slot_of(key, table, mask)
            if table[slot, 0] == key and parent[table[slot, 1]] >= 0:
                a, c = root(parent, b), root(parent, table[slot, 1])
                parent[max(a, c)] = min(a, c)
    for b in heavy[:m]:
        parent[b] = root(parent, b)
    return m


@inline
def root(parent, b):
    """The bin that names a bin's cluster."""
    while parent[b] != b:
        b = parent[b]
    return b


@kernel
def heaviest_clusters(heavy, parent, bin_weights, share, row_of_bin):
    """Ranks the clusters by weight; among equals the one seen first comes first.

    ``heavy`` (m,) int32 and ``parent`` (bins,) int32 as ``join_bins`` left them; ``share`` (bins,) float64 to work in
    -> ``row_of_bin`` (bins,) int32: rank of each bin's cluster, -1 for haze and for clusters past the first MOST.
    Returns how many there are, at most MOST.
    """
    for b in heavy:
        share[b] = 0.0
    for b in heavy:
        share[parent[b]] += bin_weights[b]
    row_of_bin[:] = -1
    rank = 0
    while rank < MOST:
        best, most = -1, 0.0
        for b in heavy:
            if share[b] > most:
                best, most = b, share[b]
        if best < 0:
            break
        share[best], row_of_bin[best] = 0.0, rank
        rank += 1
    for b in heavy:
        row_of_bin[b] = row_of_bin[parent[b]]
    return rank


@kernel
def cluster_moments(x, y, theta, weights, bin_of, row_of_bin, sums):
    """First and second moments of each cluster, about its first particle so that nothing cancels.

    ``row_of_bin`` (bins,) int32: row of ``sums`` for each bin, or -1 -> ``sums`` (clusters, MOMENTS) float64.
    """
    sums[:] = 0.0
    for i in range(x.shape[0]):
        if row_of_bin[bin_of[i]] < 0:
            continue
        s = sums[row_of_bin[bin_of[i]]]
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


@inline
def summarize(s, origin, pose, covariance):
    """Mean ``pose`` (3,) and ``covariance`` (3, 3) from the moments of a cluster, in the frame in which the poses' own
    has its ``origin`` (3,)."""
    cos, sin = math.cos(origin[2]), math.sin(origin[2])
    dx, dy, dt = s[4] / s[0], s[5] / s[0], s[6] / s[0]
    x, y, yaw = s[1] + dx, s[2] + dy, s[3] + dt + origin[2]
    pose[0], pose[1] = origin[0] + cos * x - sin * y, origin[1] + sin * x + cos * y
    pose[2] = yaw - 2.0 * math.pi * math.floor((yaw + math.pi) / (2.0 * math.pi))
    xx, xy, yy = s[7] / s[0] - dx * dx, s[8] / s[0] - dx * dy, s[10] / s[0] - dy * dy
    xt, yt, tt = s[9] / s[0] - dx * dt, s[11] / s[0] - dy * dt, s[12] / s[0] - dt * dt
    covariance[0, 0] = cos * cos * xx - 2.0 * cos * sin * xy + sin * sin * yy
    covariance[1, 1] = sin * sin * xx + 2.0 * cos * sin * xy + cos * cos * yy
    covariance[0, 1] = covariance[1, 0] = cos * sin * (xx - yy) + (cos * cos - sin * sin) * xy
    covariance[0, 2] = covariance[2, 0] = cos * xt - sin * yt
    covariance[1, 2] = covariance[2, 1] = sin * xt + cos * yt
    covariance[2, 2] = tt


@kernel
def find_clusters(x, y, theta, weights, size, turns, lightest, origin, table, bin_of, keys, bin_weights, heavy, parent,
                  row_of_bin, share, shares, poses, covariances):  # fmt: skip
    """All of the above: bins, clusters, and the heaviest of these as Gaussians.

    ``origin`` (3,) float64 as ``summarize`` has it -> ``shares`` (MOST,), ``poses`` (MOST, 3), ``covariances``
    (MOST, 3, 3) float64. Returns the numbers of bins and of clusters; -1 and 0 if the hash table is too small.
    """
    bins = occupied_bins(x, y, theta, weights, size, turns, table, bin_of, keys, bin_weights)
    if bins < 0:
        return -1, 0
    m = join_bins(turns, table, keys[:bins], bin_weights[:bins], lightest, heavy, parent)
    k = heaviest_clusters(heavy[:m], parent[:bins], bin_weights, share, row_of_bin[:bins])
    sums = np.empty((k, MOMENTS))
    cluster_moments(x, y, theta, weights, bin_of, row_of_bin, sums)
    for row in range(k):
        shares[row] = sums[row, 0]
        summarize(sums[row], origin, poses[row], covariances[row])
    return bins, k
