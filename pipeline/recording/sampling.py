"""Which particles are recorded when there are more than a viewer can draw, and what is counted over all of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.recording import palette


def draw(count: int, at_most: int, seed: int, scan: int) -> NDArray[np.int64]:
    """Indices (min(count, at_most),) of a systematic draw without replacement, increasing, the same for the same scan.

    Every particle is drawn with the same probability at_most / count, whatever its weight: light and
    heavy regions keep their true proportions. One random number places a comb of equal strides.
    """
    if count <= at_most:
        return np.arange(count)
    if at_most == 0:
        return np.empty(0, dtype=np.int64)
    offset = np.random.Generator(np.random.PCG64([seed, scan])).random()
    picked = ((np.arange(at_most) + offset) * (count / at_most)).astype(np.int64)
    return np.minimum(picked, count - 1)


def weight_bars(log_weights: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Histograms over log10(w * n): percent of the particles, and percent of the weight, per bin.

    ``log_weights``: (n,), natural, normalised. What lies outside the axis is counted in its first or last bin.
    """
    low, high = palette.HISTOGRAM_RANGE
    bins = palette.HISTOGRAM_BINS
    relative = np.clip(palette.relative_weights(log_weights, len(log_weights)), low, high)
    at = np.minimum(((relative - low) * (bins / (high - low))).astype(np.int64), bins - 1)
    particles = np.bincount(at, minlength=bins) * (100.0 / max(len(at), 1))
    weight = np.bincount(at, weights=np.exp(log_weights), minlength=bins) * 100.0
    return _rounded(particles), _rounded(weight)


def _rounded(percent: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
    return (np.round(percent * 16) / 16).astype(np.float32)
