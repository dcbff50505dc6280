"""Which particles survive, and in how many copies."""

from __future__ import annotations

from numba import prange

from pipeline.kernels import inline, kernel, paired


@inline
def last_positive(weights):
    """Index of the last weight above zero: rounding of the sum must never let a dead particle survive."""
    last = weights.shape[0] - 1
    while last > 0 and weights[last] <= 0.0:
        last -= 1
    return last


@kernel
def low_variance(weights, start, out):
    """Systematic draw (Table 4.4): one random number, then equal steps through the cumulative weights.

    ``weights`` (n,) float64 summing to one; ``start`` in [0, 1) -> ``out`` (m,) int32 ancestor of every survivor.
    """
    m = out.shape[0]
    last = last_positive(weights)
    i = 0
    cumulative = weights[0]
    for j in range(m):
        target = (start + j) / m
        while cumulative <= target and i < last:
            i += 1
            cumulative += weights[i]
        out[j] = i


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
