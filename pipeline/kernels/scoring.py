"""How well poses explain a scan, read from the table of pre-computed ranges.

``rows`` (n, headings + span) uint8 holds one row per open cell: the code of the true range in every heading, the first
``span`` headings repeated at the end so that no index needs a modulo. ``log_likelihood`` (k, 256) float32 holds one
row per beam of the scan at hand: log p(z | z*) for every code of z*. A beam then costs two look-ups and an add.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pipeline.kernels import BLOCK, inline, kernel, paired
from pipeline.kernels.elementary import sine_cosine
from pipeline.kernels.memory import prefetch

AHEAD = 32
"""So many places ahead the rows of the table are asked for: as long as memory takes to answer."""
LINE = 64
"""Bytes that memory hands over at a time."""
AT_ONCE = 40
"""Beams that a block of particles passes at a time: their likelihoods, 1 kB each, fit the first cache."""
NOWHERE = np.uint32(0xFFFFFFFF)
"""The place of a pose in a wall or off the map."""


@inline
def table_place(x, y, theta, laser_x, laser_y, laser_yaw, inv_resolution, headings, height, width):
    """Where a robot pose (m, rad, grid frame) looks: (flat cell of its laser, -1 off the map; heading of the laser).

    No branches, so that a loop over it becomes vector instructions.
    """
    sine, cosine = sine_cosine(theta)
    fx = (x + cosine * laser_x - sine * laser_y) * inv_resolution
    fy = (y + sine * laser_x + cosine * laser_y) * inv_resolution
    on_map = (fx >= np.float32(0.0)) & (fy >= np.float32(0.0)) & (fx < np.float32(width)) & (fy < np.float32(height))
    col, row = np.int32(fx if on_map else np.float32(0.0)), np.int32(fy if on_map else np.float32(0.0))
    cell = row * np.int32(width) + col if on_map else np.int32(-1)
    turn = np.floor((theta + laser_yaw) * np.float32(headings / (2.0 * math.pi)) + np.float32(0.5))
    turn -= np.float32(headings) * np.floor(turn / np.float32(headings))
    return cell, np.int32(turn if on_map else np.float32(0.0))


@inline
def find_places(
    x, y, theta, first, last, laser_x, laser_y, laser_yaw, inv_resolution, headings, row_of_cell, width, places
):
    """``places`` (BLOCK,) uint32: index into the flat table at which each of the particles ``first`` to ``last`` looks.

    Nothing here depends on what is read, so that the processor waits for many cells of the map at a time.
    """
    cells, turns = np.empty(BLOCK, np.int32), np.empty(BLOCK, np.int32)
    height, columns = row_of_cell.shape
    for i in range(first, last):
        cells[i - first], turns[i - first] = table_place(
            x[i], y[i], theta[i], laser_x, laser_y, laser_yaw, inv_resolution, headings, height, columns
        )
    flat = row_of_cell.reshape(-1)
    for j in range(last - first):
        row = flat[cells[j]] if cells[j] >= 0 else np.int32(-1)
        places[j] = np.uint32(np.int64(row) * width + turns[j]) if row >= 0 else NOWHERE


@inline
def each_once(places, n, which, slots):
    """Moves the different ones of n > 0 ``places`` to their front: how many. ``which`` (n,) int32: each particle's.

    ``slots`` (power of two,) int32: where a place was last seen. A place that another one has pushed out of its slot is
    listed twice, which costs time and changes nothing. Without branches: which place comes next cannot be foretold.
    """
    mask = np.uint32(slots.shape[0] - 1)
    slots[:] = 0
    m = 0
    for i in range(n):
        place = places[i]
        slot = ((place * np.uint32(0x9E3779B1)) >> np.uint32(16)) & mask
        seen = slots[slot]
        same = (places[seen] == place) & (m > 0)
        at = seen if same else m
        places[at] = place
        slots[slot] = at
        which[i] = at
        m += not same
    return m


@inline
def score_places(places, m, table, offsets, log_likelihood, outside, scores):
    """``scores`` (m,) float32: the sum over beams at each of ``places`` (m,), six places at a time.

    One sum waits for its own last addition; six do not wait for each other, and share what is read of the beam. Each
    is added up in the order of the beams, whoever its neighbours are.
    """
    beams = offsets.shape[0]
    passes = (beams + AT_ONCE - 1) // AT_ONCE
    likelihood = log_likelihood.reshape(-1)
    scores[:m] = np.float32(0.0)
    for part in range(passes):
        begin, end = beams * part // passes, beams * (part + 1) // passes
        least, most = np.int64(offsets[begin:end].min()), np.int64(offsets[begin:end].max())
        for j in range(min(AHEAD, m)):
            ask_for(table, places[j], least, most)
        for j in range(0, m, 6):
            for ahead in range(j + AHEAD, min(j + AHEAD + 6, m)):
                ask_for(table, places[ahead], least, most)
            j1, j2, j3 = min(j + 1, m - 1), min(j + 2, m - 1), min(j + 3, m - 1)
            j4, j5 = min(j + 4, m - 1), min(j + 5, m - 1)
            p0, p1, p2 = inside(places[j]), inside(places[j1]), inside(places[j2])
            p3, p4, p5 = inside(places[j3]), inside(places[j4]), inside(places[j5])
            s0, s1, s2, s3, s4, s5 = scores[j], scores[j1], scores[j2], scores[j3], scores[j4], scores[j5]
            for k in range(begin, end):
                # Unsigned, so that no index is asked whether it counts from the end.
                at, beam = np.uint64(offsets[k]), np.uint64(k) * np.uint64(256)
                s0 += likelihood[beam + np.uint64(table[p0 + at])]
                s1 += likelihood[beam + np.uint64(table[p1 + at])]
                s2 += likelihood[beam + np.uint64(table[p2 + at])]
                s3 += likelihood[beam + np.uint64(table[p3 + at])]
                s4 += likelihood[beam + np.uint64(table[p4 + at])]
                s5 += likelihood[beam + np.uint64(table[p5 + at])]
            scores[j], scores[j1], scores[j2], scores[j3], scores[j4], scores[j5] = s0, s1, s2, s3, s4, s5
    for j in range(m):
        if places[j] == NOWHERE:
            scores[j] = outside


@inline
def ask_for(table, place, least, most):
    """Have all lines fetched that beams from ``least`` to ``most`` touch."""
    for byte in range(least, most, LINE):
        prefetch(table, np.int64(place) + byte)
    prefetch(table, np.int64(place) + most)


@inline
def inside(place):
    """A place to read at, whatever becomes of it: NOWHERE is none."""
    return np.uint64(place) if place != NOWHERE else np.uint64(0)


@inline
def score_some(
    x, y, theta, first, last, laser_x, laser_y, laser_yaw, inv_resolution, headings, row_of_cell, rows, offsets,
    log_likelihood, outside, out,
):  # fmt: skip
    """``score`` for the particles ``first`` to ``last``, at most a BLOCK."""
    places, scores = np.empty(BLOCK, np.uint32), np.empty(BLOCK, np.float32)
    which, slots = np.empty(BLOCK, np.int32), np.empty(2 * BLOCK, np.int32)
    width = np.int64(rows.shape[1])
    find_places(
        x, y, theta, first, last, laser_x, laser_y, laser_yaw, inv_resolution, headings, row_of_cell, width, places
    )
    m = each_once(places, last - first, which, slots)
    score_places(places, m, rows.reshape(-1), offsets, log_likelihood, outside, scores)
    for i in range(first, last):
        out[i] = scores[which[i - first]]


@paired
def score(x, y, theta, laser_x, laser_y, laser_yaw, inv_resolution, headings, row_of_cell, rows, offsets,
          log_likelihood, outside, out):  # fmt: skip
    """Log-likelihood of the scan at every particle; those of a block that share cell and heading are scored once.

    ``x, y, theta`` (n,) float32 m, m, rad, grid frame; ``laser_*`` float32 m, rad on the robot; ``row_of_cell``
    (height, width) int32, -1 where no laser can be; ``offsets`` (k,) int32, k > 0, heading of each beam relative to the
    laser's; ``outside``: log-likelihood of a pose in a wall or off the map -> ``out`` (n,) float32.
    """
    n = x.shape[0]
    for b in prange((n + BLOCK - 1) // BLOCK):
        first, last = b * BLOCK, min((b + 1) * BLOCK, n)
        score_some(x, y, theta, first, last, laser_x, laser_y, laser_yaw, inv_resolution, headings, row_of_cell, rows,
                   offsets, log_likelihood, outside, out)  # fmt: skip


@paired
def score_codes(codes, log_likelihood, outside, out):
    """Log-likelihood of the scan from codes (n, k) uint8 that were cast one by one -> ``out`` (n,) float32.

    A laser inside an obstacle sees nothing but zeros (code 0): it scores ``outside``, as in the table.
    """
    for i in prange(codes.shape[0]):
        total = np.float32(0.0)
        inside = False
        for k in range(codes.shape[1]):
            total += log_likelihood[k, codes[i, k]]
            inside |= codes[i, k] != 0
        out[i] = total if inside else outside


@kernel
def look_up(x, y, theta, laser_x, laser_y, laser_yaw, inv_resolution, headings, row_of_cell, rows, offsets, out):
    """The codes that ``score`` reads for every pose -> ``out`` (n, k) uint8, left alone in a wall or off the map."""
    height, width = row_of_cell.shape
    flat = row_of_cell.reshape(-1)
    for i in range(x.shape[0]):
        cell, heading = table_place(
            x[i], y[i], theta[i], laser_x, laser_y, laser_yaw, inv_resolution, headings, height, width
        )
        row = flat[cell] if cell >= 0 else np.int32(-1)
        if row >= 0:
            for k in range(offsets.shape[0]):
                out[i, k] = rows[row, heading + offsets[k]]
