"""Every open cell times every heading, scored against one scan: where in the building could this have been seen?

For each cell the inner loop runs over headings, which are contiguous in the table and in the scratch row.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pipeline.kernels import inline, kernel, paired


@inline
def score_cell(row, headings, offsets, log_likelihood, total):
    """Log-likelihood of the scan for a laser in one cell, in every heading.

    ``row`` (headings + span,) uint8 of the table; ``offsets`` (k,) int32; ``log_likelihood`` (k, 256) float32
    -> ``total`` (headings,) float32.
    """
    total[:] = np.float32(0.0)
    for k in range(offsets.shape[0]):
        beam = log_likelihood[k]
        shifted = row[offsets[k] : offsets[k] + headings]
        for h in range(headings):
            total[h] += beam[shifted[h]]


@inline
def standing(cell, width, height, robot_dx, robot_dy, h, allowed):
    """Whether the robot's centre is in a cell where it may stand when its laser is in this cell at this heading."""
    col = int(math.floor(cell % width + 0.5 + robot_dx[h]))
    row = int(math.floor(cell // width + 0.5 + robot_dy[h]))
    return 0 <= col < width and 0 <= row < height and allowed[row, col]


@paired
def cell_masses(cells, rows, headings, offsets, log_likelihood, temper, robot_dx, robot_dy, allowed, best, log_mass):
    """For each open cell its best log-likelihood and the logarithm of its share of the tempered posterior.

    ``cells`` (n,) int32 flat; ``robot_dx, robot_dy`` (headings,) float64: the robot's centre as seen from the laser,
    in cells; ``allowed`` (height, width) bool -> ``best`` and ``log_mass`` (n,) float32, -inf where no robot can stand.
    """
    height, width = allowed.shape
    for i in prange(cells.shape[0]):
        best[i] = log_mass[i] = -np.inf
        total = np.empty(headings, np.float32)
        possible = np.empty(headings, np.bool_)
        somewhere = False
        for h in range(headings):
            possible[h] = standing(cells[i], width, height, robot_dx, robot_dy, h, allowed)
            somewhere |= possible[h]
        if not somewhere:
            continue
        score_cell(rows[i], headings, offsets, log_likelihood, total)
        largest = np.float32(-np.inf)
        for h in range(headings):
            if not possible[h]:
                total[h] = -np.inf
            largest = max(largest, total[h])
        best[i] = largest
        if largest > -np.inf:
            mass = 0.0
            for h in range(headings):
                if total[h] > -np.inf:
                    mass += math.exp(temper * (total[h] - largest))
            log_mass[i] = temper * largest + math.log(mass)


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
def draw_headings(chosen, first, cells, rows, headings, offsets, log_likelihood, temper, robot_dx, robot_dy, allowed,
                  width, at_cell, at_heading):  # fmt: skip
    """Within each chosen cell, systematic draws over its headings.

    ``chosen`` (m,) int64 rows of the table; ``first`` (m + 1,) int64: the draws of chosen[j] are first[j]..first[j + 1]
    -> ``at_cell`` (n,) int32 flat cell and ``at_heading`` (n,) int32 of the laser.
    """
    height = allowed.shape[0]
    for j in prange(chosen.shape[0]):
        i = chosen[j]
        total = np.empty(headings, np.float32)
        score_cell(rows[i], headings, offsets, log_likelihood, total)
        largest = np.float32(-np.inf)
        for h in range(headings):
            if not standing(cells[i], width, height, robot_dx, robot_dy, h, allowed):
                total[h] = -np.inf
            largest = max(largest, total[h])
        mass = 0.0
        for h in range(headings):
            mass += math.exp(temper * (total[h] - largest))
        n = first[j + 1] - first[j]
        h = 0
        cumulative = math.exp(temper * (total[0] - largest))
        for d in range(n):
            target = (d + 0.5) / n * mass
            while cumulative < target and h < headings - 1:
                h += 1
                cumulative += math.exp(temper * (total[h] - largest))
            at_cell[first[j] + d] = cells[i]
            at_heading[first[j] + d] = h
