"""A belief over the cells of a lattice, of which only those are kept that matter: a list of cells for every heading.

Lists lie one after the other: those of list h are ``start[h]`` to ``start[h + 1]`` of ``row``, ``col`` (int32) and
``weight`` (float64).
"""

from __future__ import annotations

from pipeline.kernels import kernel


@kernel
def spread(start, row, col, weight, first, source, down, right, share, plane, to_start, to_row, to_col, to_weight):
    """Table 8.1, line 3: every heading gathers from others what moves there; returns the number of cells.

    Heading t takes, for each e from ``first[t]`` to ``first[t + 1]``, ``share[e]`` of the cells in list ``source[e]``,
    moved by ``down[e]`` rows and ``right[e]`` columns; what leaves the map is gone. ``plane`` (height, width)
    float64: zeros to work in, and zeros again afterwards -> ``to_start`` (headings + 1,) int64, ``to_row``, ``to_col``,
    ``to_weight``. Returns -1 if these are too short.
    """
    height, width = plane.shape
    n = 0
    to_start[0] = 0
    for t in range(first.shape[0] - 1):
        begin, room = n, True
        for e in range(first[t], first[t + 1]):
            h = source[e]
            for k in range(start[h], start[h + 1]):
                i, j = row[k] + down[e], col[k] + right[e]
                mass = share[e] * weight[k]
                if 0 <= i < height and 0 <= j < width and mass > 0.0 and room:
                    if plane[i, j] == 0.0:
                        if n == to_row.shape[0]:
                            room = False
                            continue
                        to_row[n], to_col[n] = i, j
                        n += 1
                    plane[i, j] += mass
        for k in range(begin, n):
            to_weight[k] = plane[to_row[k], to_col[k]]
            plane[to_row[k], to_col[k]] = 0.0
        if not room:
            return -1
        to_start[t + 1] = n
    return n


@kernel
def sum_of_products(start, row, col, weight, at_start, at_row, at_col, factor, plane):
    """The sum of weight times factor over the cells of one set of lists, with the factors of another set's cells.

    ``at_*``: lists that hold every cell of the first; ``factor`` (m,) float64; ``plane`` (height, width) float64.
    """
    total = 0.0
    for h in range(start.shape[0] - 1):
        for k in range(at_start[h], at_start[h + 1]):
            plane[at_row[k], at_col[k]] = factor[k]
        for k in range(start[h], start[h + 1]):
            total += weight[k] * plane[row[k], col[k]]
        for k in range(at_start[h], at_start[h + 1]):
            plane[at_row[k], at_col[k]] = 0.0
    return total
