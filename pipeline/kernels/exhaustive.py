"""Every open cell times every heading, scored against one scan: where in the building could this have been seen?

For each cell the inner loop runs over headings, which are contiguous in the table and in the scratch row.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pipeline.kernels import inline, kernel, paired
from pipeline.kernels.random import uniform

_NO_KEY = np.uint64(0)


@inline
def score_cell(row, headings, offsets, log_likelihood, total):
    """Log-likelihood of the scan for a laser in one cell, in every heading.

    ``row`` (headings + span,) uint8 of the table; ``offsets`` (k,) int32; ``log_likelihood`` (k, 256) float32
    -> ``total`` (headings,) float32.
    """
    total[:] = np.float32(0.0)
    beams = offsets.shape[0]
    # Four beams in one go: their sum is fetched and put back once, not four times.
    fours = beams - beams % 4
    for k in range(0, fours, 4):
        beam0, beam1, beam2, beam3 = (
            log_likelihood[k],
            log_likelihood[k + 1],
            log_likelihood[k + 2],
            log_likelihood[k + 3],
        )
        row0, row1 = _turned(row, offsets[k], headings), _turned(row, offsets[k + 1], headings)
        row2, row3 = _turned(row, offsets[k + 2], headings), _turned(row, offsets[k + 3], headings)
        for h in range(headings):
            total[h] += (beam0[row0[h]] + beam1[row1[h]]) + (beam2[row2[h]] + beam3[row3[h]])
    for k in range(fours, beams):
        beam0, row0 = log_likelihood[k], _turned(row, offsets[k], headings)
        for h in range(headings):
            total[h] += beam0[row0[h]]


@inline
def _turned(row, offset, headings):
    return row[offset : offset + headings]


@inline
def standing(cell, width, height, robot_col, robot_row, h, allowed):
    """Whether the robot's centre is in a cell where it may stand when its laser is in this cell at this heading."""
    col = cell % width + robot_col[h]
    row = cell // width + robot_row[h]
    return 0 <= col < width and 0 <= row < height and allowed[row, col]


@kernel
def standing_rows(cells, robot_col, robot_row, allowed):
    """Indices (m,) int64 into ``cells`` (n,) of those where the robot may stand in at least one heading."""
    height, width = allowed.shape
    out = np.empty(cells.shape[0], np.int64)
    m = 0
    for i in range(cells.shape[0]):
        for h in range(robot_col.shape[0]):
            if standing(cells[i], width, height, robot_col, robot_row, h, allowed):
                out[m] = i
                m += 1
                break
    return out[:m]


@inline
def score_standing(cell, row, offsets, log_likelihood, robot_col, robot_row, allowed, total):
    """``score_cell``, with -inf in the headings in which the robot cannot stand; returns the best."""
    height, width = allowed.shape
    headings = robot_col.shape[0]
    score_cell(row, headings, offsets, log_likelihood, total)
    largest = np.float32(-np.inf)
    for h in range(headings):
        if not standing(cell, width, height, robot_col, robot_row, h, allowed):
            total[h] = -np.inf
        largest = max(largest, total[h])
    return largest


@inline
def exponentiate(total, largest, temper):
    """total = exp(temper * (total - largest)), in place; their sum. ``total`` (n,) float32, nowhere above ``largest``.

    By the sixth square of a polynomial, all of it vector instructions: the exponential of a library takes longer than
    the beams do. Wrong by 5e-6 at most; what is below exp(-60) is nothing.
    """
    sixty_fourth = temper * np.float32(1.0 / 64.0)
    for h in range(total.shape[0]):
        x = max((total[h] - largest) * sixty_fourth, np.float32(-1.0))
        e = np.float32(1.0) + x * (
            np.float32(1.0)
            + x * (np.float32(1 / 2) + x * (np.float32(1 / 6) + x * (np.float32(1 / 24) + x * np.float32(1 / 120))))
        )
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        total[h] = e if x > np.float32(-60.0 / 64.0) else np.float32(0.0)
    mass = 0.0
    for h in range(total.shape[0]):
        mass += total[h]
    return mass


@paired
def cell_masses(chosen, cells, rows, offsets, log_likelihood, temper, robot_col, robot_row, allowed, best, log_mass):
    """For each chosen cell its best log-likelihood and the logarithm of its share of the tempered posterior.

    ``chosen`` (m,) int64 rows of the table; ``cells`` (n,) int32 flat; ``robot_col, robot_row`` (headings,) int64: the
    robot's centre as seen from the laser, in cells; ``allowed`` (height, width) bool -> ``best``, ``log_mass`` (m,)
    float32, -inf where no robot can stand.
    """
    headings = robot_col.shape[0]
    for j in prange(chosen.shape[0]):
        i = chosen[j]
        total = np.empty(headings, np.float32)
        largest = score_standing(cells[i], rows[i], offsets, log_likelihood, robot_col, robot_row, allowed, total)
        best[j] = largest
        log_mass[j] = -np.inf
        if largest > -np.inf:
            log_mass[j] = temper * largest + math.log(exponentiate(total, largest, temper))


@kernel
def split_draws(mass, start, n, draws):
    """How many of n systematic draws fall into each cell: ``mass`` (m,) float64, sum one -> ``draws`` (m,) int64."""
    drawn = 0
    cumulative = 0.0
    for i in range(mass.shape[0]):
        cumulative += mass[i]
        upto = min(n, max(drawn, int(math.ceil(cumulative * n - start))))
        draws[i] = upto - drawn
        drawn = upto
    i = int(np.argmax(mass))  # rounding of the sum may leave one draw over
    draws[i] += n - drawn


@paired
def draw_headings(chosen, first, cells, rows, offsets, log_likelihood, temper, robot_col, robot_row, allowed,
                  at_cell, at_heading, key=_NO_KEY):  # fmt: skip
    """Within each chosen cell, systematic draws over its headings, from a random start of the cell's own.

    ``chosen`` (m,) int64 rows of the table; ``first`` (m + 1,) int64: the draws of chosen[j] are first[j] to
    first[j + 1]; ``key`` of the random stream, in which first[j] is the counter -> ``at_cell`` (n,) int32
    flat cell and ``at_heading`` (n,) int32 of the laser.
    """
    headings = robot_col.shape[0]
    for j in prange(chosen.shape[0]):
        i = chosen[j]
        total = np.empty(headings, np.float32)
        largest = score_standing(cells[i], rows[i], offsets, log_likelihood, robot_col, robot_row, allowed, total)
        mass = exponentiate(total, largest, temper)
        n = first[j + 1] - first[j]
        start = 1.0 - uniform(key, first[j])  # above 0, so that a heading without mass is never the first
        h = 0
        cumulative = float(total[0])
        for d in range(n):
            target = (d + start) / n * mass
            while cumulative < target and h < headings - 1:
                h += 1
                cumulative += total[h]
            at_cell[first[j] + d] = cells[i]
            at_heading[first[j] + d] = h
