"""How many particles: the bound of KLD-sampling, and the number that meets it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from pipeline.config import Config
from pipeline.filter.adaptive import kld_bound, kld_particles, next_count, without_duplicates


@pytest.mark.parametrize("bins", [2, 3, 10, 100, 5000])
def test_the_bound_is_the_chi_square_quantile(bins: int) -> None:
    """Equation 8.13, of which 8.14 is Wilson and Hilferty's approximation: good to some percent."""
    exact = stats.chi2.ppf(0.99, bins - 1) / (2 * 0.05)
    assert kld_bound(bins, 0.05, stats.norm.ppf(0.99)) == pytest.approx(exact, rel=0.03)


def test_the_bound_grows_with_the_bins_and_falls_with_the_error() -> None:
    bounds = [kld_bound(k, 0.05, 2.33) for k in (1, 2, 5, 50, 500)]
    assert bounds[0] == 1.0
    assert (np.diff(bounds) > 0).all()
    assert kld_bound(50, 0.1, 2.33) == pytest.approx(kld_bound(50, 0.05, 2.33) / 2)


def config(**values) -> Config:
    return Config(**({"min_particles": 100, "max_particles": 50_000, "kld_err": 0.05, "kld_z": 2.33} | values))


@pytest.mark.parametrize("bins", [1, 3, 40, 600])
def test_the_fewest_particles_that_meet_the_bound(bins: int) -> None:
    rng = np.random.default_rng(bins)
    weights = rng.exponential(size=bins) ** 2
    weights /= weights.sum()
    n = kld_particles(weights, config())
    hit = np.mean([len(np.unique(rng.choice(bins, n, p=weights))) for _ in range(50)])
    # Within the scatter of the bins that 50 trials hit.
    assert n >= 0.97 * kld_bound(hit, 0.05, 2.33)
    if n > 100:
        fewer = int(0.9 * n)
        hit = np.mean([len(np.unique(rng.choice(bins, fewer, p=weights))) for _ in range(50)])
        assert fewer < kld_bound(hit, 0.05, 2.33)


def test_within_the_limits() -> None:
    assert kld_particles(np.ones(1), config()) == 100
    assert kld_particles(np.full(30_000, 1 / 30_000), config()) == 50_000


def test_without_duplicates() -> None:
    """Where all weigh the same few are lost; where three hold it all, three differ, and the minimum is kept."""
    assert without_duplicates(1000, np.full(1000, 1e-3), config()) == 1000
    few = np.zeros(1000)
    few[:3] = 1 / 3
    assert without_duplicates(1000, few, config()) == 100
    some = np.zeros(1000)
    some[:300] = 1 / 300
    assert without_duplicates(1000, some, config()) == pytest.approx(290, abs=10)


def test_next_count_does_what_the_configuration_says() -> None:
    weights, bins = np.full(2000, 1 / 2000), np.full(5, 0.2)
    assert next_count(2000, weights, bins, config(adaptive="none")) == 2000
    assert next_count(2000, weights, bins, config(adaptive="kld")) == kld_particles(bins, config())
    assert next_count(2000, weights, bins, config(adaptive="duplicates")) == 2000
