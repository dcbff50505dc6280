"""Survival of the fittest: the resamplers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.kernels import BLOCK, resampling
from pipeline.kernels.random import uniforms
from pipeline.parts.loading import built_in
from pipeline.parts.own import Own
from pipeline.parts.roles import ROLES

Resampler = Callable[[NDArray[np.float64], int, np.uint64], NDArray[np.int32]]
"""Weights (m,) float64 summing to one, how many shall survive, and the key of random numbers -> their indices (n,)."""


def low_variance(weights: NDArray[np.float64], n: int, key: np.uint64) -> NDArray[np.int32]:
    """(n,) int32 indices of the particles that survive, ascending (Probabilistic Robotics, Table 4.4)."""
    ancestors = np.empty(n, np.int32)
    blocks = -(-len(weights) // BLOCK)
    resampling.low_variance(5 * n, weights, uniforms(key, 1)[0], np.empty(blocks + 1), ancestors)
    return ancestors


def multinomial(weights: NDArray[np.float64], n: int, key: np.uint64) -> NDArray[np.int32]:
    """(n,) int32 indices of the particles that survive: independent draws, made in ascending order."""
    ancestors = np.empty(n, np.int32)
    resampling.multinomial(weights, np.sort(uniforms(key, n)), ancestors)
    return ancestors


def resampler(config: Config) -> Resampler:
    """The resampler that ``config.resampler`` names."""
    own = config.own_part("resampler")
    found: Resampler = built_in(ROLES["resampler"], config.resampler) if own is None else _by(own)
    return found


def _by(own: Own) -> Resampler:
    def draw(weights: NDArray[np.float64], n: int, key: np.uint64) -> NDArray[np.int32]:
        rng = np.random.Generator(np.random.Philox(key=int(key)))
        answer = np.asarray(own(weights.copy(), n, rng=rng))
        indices = own.array(answer, (n,), "indices of the survivors").astype(np.int64)
        if answer.dtype == np.bool_ or (indices != answer).any():
            raise own.wrong(f"it gave {answer.dtype.name} values that are no indices, expected whole numbers")
        if n and not (indices.min() >= 0 and indices.max() < len(weights)):
            raise own.wrong(f"it gave an index outside 0 to {len(weights) - 1}")
        return np.sort(indices).astype(np.int32)

    return draw


def teeth(draw: Resampler, n: int, key: np.uint64) -> NDArray[np.float64] | None:
    """(n,) where a resampler looks at the cumulative weights, ascending in [0, 1); None for one of the user's own."""
    if draw is low_variance:
        return (np.arange(n) + uniforms(key, 1)[0]) / n
    return np.sort(uniforms(key, n)) if draw is multinomial else None
