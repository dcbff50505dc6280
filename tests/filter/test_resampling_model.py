"""Survival of the fittest: how often, on average, and that it is no lottery for the same seed."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.filter.resampling import low_variance, multinomial
from pipeline.kernels.random import stream_key

METHODS = [low_variance, multinomial]
WEIGHTS = np.array([0.0, 0.3, 0.05, 0.0, 0.2, 0.45, 0.0])


@pytest.mark.parametrize("method", METHODS)
def test_deterministic_and_ascending(method) -> None:
    first = method(WEIGHTS, 50, stream_key(1, 2, 2))
    np.testing.assert_array_equal(first, method(WEIGHTS, 50, stream_key(1, 2, 2)))
    assert (np.diff(first) >= 0).all()
    others = [method(WEIGHTS, 50, stream_key(1, scan, 2)).tolist() for scan in range(3, 40)]
    assert any(other != first.tolist() for other in others)


@pytest.mark.parametrize("method", METHODS)
def test_zero_weights_never_survive(method) -> None:
    rng = np.random.default_rng(0)
    for scan in range(200):
        weights = rng.random(30) * (rng.random(30) < 0.4)
        weights[rng.integers(30)] = 1.0
        weights /= weights.sum()
        assert (weights[method(weights, 100, stream_key(0, scan, 2))] > 0).all()


def test_low_variance_keeps_floor_or_ceiling_of_each_share() -> None:
    rng = np.random.default_rng(1)
    for scan in range(200):
        weights = rng.exponential(size=25)
        weights /= weights.sum()
        counts = np.bincount(low_variance(weights, 40, stream_key(3, scan, 2)), minlength=25)
        assert (counts >= np.floor(40 * weights)).all()
        assert (counts <= np.ceil(40 * weights)).all()


def counts(method, n: int, trials: int) -> np.ndarray:
    return np.stack(
        [np.bincount(method(WEIGHTS, n, stream_key(9, trial, 2)), minlength=len(WEIGHTS)) for trial in range(trials)]
    )


@pytest.mark.parametrize("method", METHODS)
def test_every_particle_survives_in_proportion_to_its_weight(method) -> None:
    trials, n = 4000, 10
    drawn = counts(method, n, trials)
    error = np.sqrt(n * WEIGHTS * (1 - WEIGHTS) / trials)
    assert (np.abs(drawn.mean(axis=0) - n * WEIGHTS) <= 5 * error).all()


def test_multinomial_has_the_multinomial_variance() -> None:
    trials, n = 4000, 10
    variance = counts(multinomial, n, trials).var(axis=0)
    np.testing.assert_allclose(variance, n * WEIGHTS * (1 - WEIGHTS), rtol=0.12)


def test_low_variance_deserves_its_name() -> None:
    assert (counts(low_variance, 10, 500).var(axis=0) <= 0.25 + 1e-9).all()


def test_equal_weights_survive_once_each() -> None:
    weights = np.full(64, 1 / 64)
    np.testing.assert_array_equal(low_variance(weights, 64, stream_key(0, 0, 2)), np.arange(64))
