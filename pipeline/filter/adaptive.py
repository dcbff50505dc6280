"""How many particles the belief needs."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config


def kld_bound(bins: float, err: float, z: float) -> float:
    """Particles that keep the Kullback-Leibler distance to a belief over so many bins below ``err``.

    Equation 8.14 (Wilson and Hilferty's approximation of the chi-square quantile); ``z`` is the upper quantile of the
    standard normal for the probability that the bound holds. One bin needs one particle.
    """
    if bins <= 1.0:
        return 1.0
    a = 2.0 / (9.0 * (bins - 1.0))
    return (bins - 1.0) / (2.0 * err) * (1.0 - a + math.sqrt(a) * z) ** 3


def kld_particles(bin_weights: NDArray[np.float64], config: Config) -> int:
    """KLD-sampling (Table 8.4) without drawing one by one: the fewest draws n that satisfy the bound for the number of
    bins that n draws are expected to hit.

    ``bin_weights`` (m,) weights of the occupied bins, summing to one. Within min_particles and max_particles.
    """
    log_missed = np.log1p(-np.minimum(bin_weights, 1.0 - 1e-12))  # log-probability that one draw misses the bin
    low, high = min(config.min_particles, config.max_particles), config.max_particles
    while low < high:
        n = (low + high) // 2
        hit = len(bin_weights) - float(np.exp(n * log_missed).sum())
        if n >= kld_bound(hit, config.kld_err, config.kld_z):
            high = n
        else:
            low = n + 1
    return low


def without_duplicates(n: int, weights: NDArray[np.float64], config: Config) -> int:
    """The report's proposal: where more than half of the n survivors are copies of others, keep as many as differ."""
    different = len(weights) - float(np.exp(n * np.log1p(-np.minimum(weights, 1.0 - 1e-12))).sum())
    if different >= n / 2:
        return n
    return int(min(config.max_particles, max(config.min_particles, round(different))))


def next_count(n: int, weights: NDArray[np.float64], bin_weights: NDArray[np.float64], config: Config) -> int:
    """How many particles the next resampling draws, as ``config.adaptive`` says."""
    if config.adaptive == "kld":
        return kld_particles(bin_weights, config)
    if config.adaptive == "duplicates":
        return without_duplicates(n, weights, config)
    return n
