"""The nearest cell of a kind, as far as a few cells away: all that walls need, without waiting for scipy to load."""

from __future__ import annotations

import numpy as np

from pipeline.kernels import kernel


@kernel
def nearest(wanted, reach, squared, at):
    """For each cell the nearest wanted one: squared distance between their centres in cells, and where it is.

    ``wanted`` (height, width) bool; ``reach``: rows and columns to look aside -> ``squared`` (height, width) int32, and
    ``at`` int32 flat index; where none is in reach, FAR and -1.
    """
    height, width = wanted.shape
    beside = np.empty((height, width), np.int32)  # column of the nearest in the same row, or -1
    for row in range(height):
        last = -1
        for col in range(width):
            last = col if wanted[row, col] else last
            beside[row, col] = last if last >= 0 and col - last <= reach else -1
        last = -1
        for col in range(width - 1, -1, -1):
            last = col if wanted[row, col] else last
            known = beside[row, col]
            if last >= 0 and last - col <= reach and (known < 0 or last - col < col - known):
                beside[row, col] = last
    for row in range(height):
        for col in range(width):
            best, where = FAR, -1
            for other in range(max(0, row - reach), min(height, row + reach + 1)):
                found = beside[other, col]
                if found >= 0:
                    distance = (other - row) * (other - row) + (found - col) * (found - col)
                    if distance < best:
                        best, where = distance, other * width + found
            squared[row, col] = best
            at[row, col] = where


FAR = 1 << 30
