"""Which particles survive, and in how many copies."""

from __future__ import annotations

import math

from numba import prange

from pipeline.kernels import BLOCK, inline, kernel, paired


@inline
def last_positive(weights):
    """Index of the last weight above zero: rounding of the sum must never let a dead particle survive."""
    last = weights.shape[0] - 1
    while last > 0 and weights[last] <= 0.0:
        last -= 1
    return last


@paired
def low_variance(weights, start, upto, out):
    """Systematic draw (Table 4.4): one random number, then equal steps through the cumulative weights.

    ``weights`` (n,) float64 summing to one; ``start`` in [0, 1); ``upto`` (blocks + 1,) float64 to work in
    -> ``out`` (m,) int32 ancestor of every survivor.
    """
    n, m, blocks = weights.shape[0], out.shape[0], upto.shape[0] - 1
    for b in prange(blocks):
        total = 0.0
        for i in range(b * BLOCK, min((b + 1) * BLOCK, n)):
            total += weights[i]
        upto[b + 1] = total
    upto[0] = 0.0
    last = 0
    for b in range(blocks):
        last = b if upto[b + 1] > 0.0 else last
        upto[b + 1] += upto[b]
    for b in prange(last + 1):
        j = steps_below(upto[b], start, m)
        # Rounding of the sum must neither lose a survivor nor raise a particle that is dead.
        end = m if b == last else steps_below(upto[b + 1], start, m)
        cumulative, alive = upto[b], b * BLOCK
        for i in range(b * BLOCK, min((b + 1) * BLOCK, n)):
            cumulative += weights[i]
            alive = i if weights[i] > 0.0 else alive
            while j < end and (start + j) / m < cumulative:
                out[j] = i
                j += 1
        while j < end:
            out[j] = alive
            j += 1


@inline
def steps_below(limit, start, m):
    """How many of the m steps (start + j) / m lie below a limit."""
    j = max(0, min(m, int(math.ceil(limit * m - start))))
    while j < m and (start + j) / m < limit:
        j += 1
    while j > 0 and (start + j - 1) / m >= limit:
        j -= 1
    return j


@kernel
def multinomial(weights, sorted_uniforms, out):
    """Independent draws: ``sorted_uniforms`` (m,) float64 ascending in [0, 1) -> ``out`` (m,) int32 ancestors."""
    last = last_positive(weights)
    i = 0
    cumulative = weights[0]
    for j in range(out.shape[0]):
        while cumulative <= sorted_uniforms[j] and i < last:
            i += 1
            cumulative += weights[i]
        out[j] = i


@paired
def gather(source, ancestors, out):
    """out[:, j] = source[:, ancestors[j]]; source (3, n) float32, ancestors (m,) int32, out (3, m)."""
    for j in prange(ancestors.shape[0]):
        a = ancestors[j]
        out[0, j] = source[0, a]
        out[1, j] = source[1, a]
        out[2, j] = source[2, a]
