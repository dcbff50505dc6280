"""The table of ranges: every heading from the centre of every open cell, and a sum that tells whether it is whole.

Lengths are in cells; ``opaque`` is (height, width) uint8 as in ``raycast``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pipeline.kernels import inline, kernel, paired

FARTHEST = 255
STEPS = 16
"""Steps of a cell in which a range's code is looked up before it is made exact."""
INTO = 1e-9
"""Cells beyond a border at which a ray is in the next cell, whatever rounding says."""


@kernel
def clearance(opaque, out):
    """How far the nearest cell is that ends a ray: in king's moves, at most FARTHEST; 0 where it ends.

    ``opaque`` (height, width) uint8 as in ``raycast``, with one cell on every side that lies off the map; ``out`` is
    like it. Two sweeps, as for any chamfer distance.
    """
    height, width = opaque.shape
    out[:] = 0
    for row in range(1, height - 1):
        for col in range(1, width - 1):
            if opaque[row, col] == 0:
                before = min(out[row - 1, col - 1], out[row - 1, col], out[row - 1, col + 1], out[row, col - 1])
                out[row, col] = min(np.int64(before) + 1, FARTHEST)
    for row in range(height - 2, 0, -1):
        for col in range(width - 2, 0, -1):
            if opaque[row, col] == 0:
                after = min(out[row + 1, col - 1], out[row + 1, col], out[row + 1, col + 1], out[row, col + 1])
                out[row, col] = min(np.int64(out[row, col]), np.int64(after) + 1)


@inline
def cast_round(start, clear, towards_x, towards_y, across, slope_x, slope_y, times, ends, active):
    """Every heading from a cell's centre: ``times`` (headings,) float64 range in cells, ``ends`` int64 last cell.

    What ``raycast.dda`` finds, but over as many cells at a time as are open for sure: to where the ray leaves the
    square of its clearance. All headings take a step before any takes the next, so that none waits for another.
    ``start`` index into the flat ``clear``; ``towards_*`` (headings,) int64 way of a step, ``across`` and ``slope_*``
    absolute cosine, sine and their inverses; ``active`` (headings,) int64 to work in.
    """
    cos, sin = across
    m = times.shape[0]
    for h in range(m):
        active[h] = h
        times[h] = 0.0
    while m > 0:
        going = 0
        for a in range(m):
            h = active[a]
            t = times[h] + INTO
            col, row = np.int64(t * cos[h] + 0.5), np.int64(t * sin[h] + 0.5)
            cell = start + col * towards_x[h] + row * towards_y[h]
            free = np.int64(clear[cell])
            leave = min((col + free - 0.5) * slope_x[h], (row + free - 0.5) * slope_y[h])
            times[h] = leave if free > 0 else times[h]
            ends[h] = cell
            active[going] = h
            going += 1 if free > 0 else 0
        m = going


@paired
def build_table(opaque, clear, cells, headings, max_range, borders, code_at, out):
    """Range codes (``raycast.encode``) from the centre of every listed cell in every heading.

    ``opaque`` and ``clear`` (height + 2, width + 2) uint8 as ``clearance`` has them; ``cells`` (n,) int64 flat indices
    into these; ``headings``: number of headings in a full turn; ``borders`` (2, codes) float64 shortest range of each
    code of obstacles and of unknown land, inf behind the last; ``code_at`` (2, m) uint8: which of them it is at every
    STEPS-th of a cell -> ``out`` (n, headings or more) uint8, the first headings repeated where there is room.
    """
    width = opaque.shape[1]
    kinds, free = opaque.reshape(-1), clear.reshape(-1)
    angles = 2.0 * math.pi * np.arange(headings) / headings
    cos, sin = np.cos(angles), np.sin(angles)
    towards_x, towards_y = np.where(cos > 0.0, 1, -1), np.where(sin > 0.0, width, -width)
    cos, sin = np.abs(cos), np.abs(sin)
    # A ray along a border never leaves through it; 0 times infinity would be nothing at all.
    slope_x, slope_y = 1.0 / np.maximum(cos, 1e-300), 1.0 / np.maximum(sin, 1e-300)
    last = code_at.shape[1] - 1
    for b in prange((cells.shape[0] + ROWS - 1) // ROWS):
        times, ends = np.empty(headings), np.empty(headings, np.int64)
        active = np.empty(headings, np.int64)
        for i in range(b * ROWS, min((b + 1) * ROWS, cells.shape[0])):
            cast_round(cells[i], free, towards_x, towards_y, (cos, sin), slope_x, slope_y, times, ends, active)
            for h in range(headings):
                distance, kind = times[h], np.int64(kinds[ends[h]]) - 1
                if kind < 0 or distance > max_range:
                    out[i, h] = 255
                    continue
                code = np.int64(code_at[kind, min(np.int64(distance * STEPS), last)])
                while distance >= borders[kind, code + 1]:
                    code += 1
                out[i, h] = code + kind * FIRST_UNKNOWN
            for h in range(headings, out.shape[1]):
                out[i, h] = out[i, h % headings]


ROWS = 64
FIRST_UNKNOWN = 224
"""``range_table.HIT_CODES``: code of unknown land at the laser itself."""

WORDS = 1 << 15


@paired
def mix(words, sums):
    """For each block of WORDS ``words`` (n,) uint64 one sum of them, each stirred with its place -> ``sums`` (blocks,).

    No damaged bit leaves a word's share as it was, and no word may change its place.
    """
    n = words.shape[0]
    for b in prange(sums.shape[0]):
        total = np.uint64(0)
        for i in range(b * WORDS, min((b + 1) * WORDS, n)):
            z = words[i] ^ (np.uint64(i) * np.uint64(0x9E3779B97F4A7C15))
            z = (z ^ (z >> np.uint64(32))) * np.uint64(0xBF58476D1CE4E5B9)
            total += z ^ (z >> np.uint64(29))
        sums[b] = total
