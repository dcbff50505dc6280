"""Every open cell times every heading, scored against one scan: where in the building could this have been seen?

For each cell the inner loop runs over headings, which are contiguous in the table and in the scratch row.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pipeline.kernels import inline, kernel, paired
from pipeline.kernels.elementary import exponential, largest_of, sum_of
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


@paired
def count_standing(cells, robot_col, robot_row, allowed, out):
    """At how many of the places ``robot_col, robot_row`` (k,) seen from a laser in each cell the robot may stand.

    ``cells`` (n,) int32 flat -> ``out`` (n,) int32.
    """
    height, width = allowed.shape
    for i in prange(cells.shape[0]):
        count = 0
        for h in range(robot_col.shape[0]):
            count += standing(cells[i], width, height, robot_col, robot_row, h, allowed)
        out[i] = count


@inline
def score_standing(cell, open_around, row, offsets, log_likelihood, robot_col, robot_row, allowed, total):
    """``score_cell``, with -inf in the headings in which the robot cannot stand; returns the best.

    ``open_around``: it can in all of them, as in most cells.
    """
    height, width = allowed.shape
    headings = robot_col.shape[0]
    score_cell(row, headings, offsets, log_likelihood, total)
    if not open_around:
        for h in range(headings):
            if not standing(cell, width, height, robot_col, robot_row, h, allowed):
                total[h] = -np.inf
    return largest_of(total)


@inline
def exponentiate(total, largest, temper):
    """total = exp(temper * (total - largest)), in place; their sum.

    ``total`` (n,) float32, nowhere above ``largest``.
    """
    for h in range(total.shape[0]):
        total[h] = exponential(temper * (total[h] - largest))
    return sum_of(total, 0, total.shape[0])


@paired
def cell_masses(chosen, cells, open_around, rows, offsets, log_likelihood, temper, robot_col, robot_row, allowed,
                best, log_mass):  # fmt: skip
    """For each chosen cell its best log-likelihood and the logarithm of its share of the tempered posterior.

    ``chosen`` (m,) int64 rows of the table; ``cells`` (n,) int32 flat; ``robot_col, robot_row`` (headings,) int64: the
    robot's centre as seen from the laser, in cells; ``allowed`` (height, width) bool; ``open_around`` (n,) bool: where
    it is allowed in all headings -> ``best``, ``log_mass`` (m,) float32, -inf where no robot can stand.
    """
    headings = robot_col.shape[0]
    for j in prange(chosen.shape[0]):
        i = chosen[j]
        total = np.empty(headings, np.float32)
        largest = score_standing(cells[i], open_around[i], rows[i], offsets, log_likelihood, robot_col, robot_row,
                                 allowed, total)  # fmt: skip
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
    last = mass.shape[0] - 1
    while last > 0 and mass[last] <= 0.0:
        last -= 1
    draws[last] += n - drawn  # rounding of the sum may leave one draw over


@paired
def draw_headings(chosen, first, cells, open_around, rows, offsets, log_likelihood, temper, robot_col, robot_row,
                  allowed, at_cell, at_heading, key=_NO_KEY):  # fmt: skip
    """Within each chosen cell, systematic draws over its headings, from a random start of the cell's own.

    ``chosen`` (m,) int64 rows of the table; ``first`` (m + 1,) int64: the draws of chosen[j] are first[j] to
    first[j + 1]; ``key`` of the random stream, in which first[j] is the counter -> ``at_cell`` (n,) int32
    flat cell and ``at_heading`` (n,) int32 of the laser.
    """
    headings = robot_col.shape[0]
    for j in prange(chosen.shape[0]):
        i = chosen[j]
        total = np.empty(headings, np.float32)
        largest = score_standing(cells[i], open_around[i], rows[i], offsets, log_likelihood, robot_col, robot_row,
                                 allowed, total)  # fmt: skip
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
