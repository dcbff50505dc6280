"""Survival of the fittest: which resampler, in one place."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels import BLOCK, resampling
from pipeline.kernels.random import uniforms


def draw_ancestors(
    weights: NDArray[np.float64], n: int, method: Literal["low_variance", "multinomial"], key: np.uint64
) -> NDArray[np.int32]:
    """(n,) int32 indices of the particles that survive, ascending; weights (m,) float64 summing to one.

    low_variance: Probabilistic Robotics, Table 4.4; multinomial: n independent draws, made in ascending order.
    """
    ancestors = np.empty(n, np.int32)
    if method == "low_variance":
        blocks = -(-len(weights) // BLOCK)
        resampling.low_variance(5 * n, weights, uniforms(key, 1)[0], np.empty(blocks + 1), ancestors)
    else:
        resampling.multinomial(weights, np.sort(uniforms(key, n)), ancestors)
    return ancestors


def teeth(n: int, method: Literal["low_variance", "multinomial"], key: np.uint64) -> NDArray[np.float64]:
    """(n,) where ``draw_ancestors`` looks at the cumulative weights, ascending in [0, 1), for whoever draws it."""
    return (np.arange(n) + uniforms(key, 1)[0]) / n if method == "low_variance" else np.sort(uniforms(key, n))
