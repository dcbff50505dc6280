"""Expectation-Maximization: it finds the model that readings were drawn from, and never makes them less likely."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.config import Config
from pipeline.filter.beam_model import mixture_density, no_return_mass
from pipeline.tune.em import FLOOR, PARTS, Readings, fit_beam_model

MAX_RANGE = 20.0
TRUTH = Config(
    z_hit=0.55, z_short=0.15, z_long=0.2, z_rand=0.06, z_max=0.04, sigma_hit=0.12, lambda_short=0.4, lambda_long=0.8,
    range_bias=0.15,
)  # fmt: skip
START = Config(range_bias=0.05)


def truncated(rng: np.random.Generator, rate: float, length: np.ndarray) -> np.ndarray:
    """Exponential readings over [0, length], by inversion."""
    return -np.log1p(rng.uniform(size=len(length)) * np.expm1(-rate * length)) / rate


def drawn(n: int, config: Config = TRUTH, seed: int = 0) -> Readings:
    rng = np.random.default_rng(seed)
    star = rng.uniform(1.0, 15.0, n)
    cause = rng.choice(len(PARTS), n, p=[getattr(config, part) for part in PARTS])
    z = np.choose(
        cause,
        [
            rng.normal(star, config.sigma_hit),
            truncated(rng, config.lambda_short, star),
            star + truncated(rng, config.lambda_long, MAX_RANGE - star),
            rng.uniform(0.0, MAX_RANGE, n),
            np.full(n, np.inf),
        ],
    )
    assert config.range_bias is not None
    return Readings((z + config.range_bias).reshape(-1, 50), star.reshape(-1, 50), MAX_RANGE)


def test_the_model_that_drew_the_readings_is_recovered() -> None:
    fit = fit_beam_model([drawn(10_000, seed=1), drawn(10_000, seed=2)], START)
    # Four deviations of what 20,000 readings can tell; hits beside the ends of short and long ones cost some more.
    for part in PARTS:
        assert getattr(fit.config, part) == pytest.approx(getattr(TRUTH, part), abs=0.016)
    assert fit.config.sigma_hit == pytest.approx(TRUTH.sigma_hit, rel=0.04)
    assert fit.config.lambda_short == pytest.approx(TRUTH.lambda_short, rel=0.2)
    assert fit.config.lambda_long == pytest.approx(TRUTH.lambda_long, rel=0.15)
    assert fit.config.range_bias == pytest.approx(TRUTH.range_bias, abs=0.01)
    assert sum(getattr(fit.config, part) for part in PARTS) == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(4))
def test_likelihood_never_falls(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start = Config(
        sigma_hit=rng.uniform(0.02, 1.0),
        lambda_short=rng.uniform(0.05, 3.0),
        lambda_long=rng.uniform(0.05, 3.0),
        range_bias=rng.uniform(-0.2, 0.4),
    )
    readings = drawn(4000, seed=seed)
    # Also near both ends of the range, where the closed forms of the book would be wrong, and without an obstacle.
    readings.expected[:10] = rng.uniform(0.0, 0.3, (10, 50))
    readings.expected[10:20] = rng.uniform(MAX_RANGE - 0.3, MAX_RANGE, (10, 50))
    readings.expected[20:25] = np.inf
    history = np.array(fit_beam_model([readings], start).history)
    assert len(history) > 3
    assert np.diff(history).min() >= -1e-12
    assert history[-1] > history[0]


def test_likelihood_is_the_filter_s_own() -> None:
    readings = Readings(np.array([[3.0, np.inf, np.nan, 1.0, np.inf]]), np.array([[2.8, 4.0, 4.0, np.inf, np.inf]]), 20)
    found = readings.log_likelihood(TRUTH)[0]
    assert found[0] == pytest.approx(np.log(mixture_density(2.85, 2.8, TRUTH, 20.0)))
    assert found[1] == pytest.approx(np.log(TRUTH.z_max))
    assert found[2] == 0.0
    assert found[3] == pytest.approx(np.log(mixture_density(0.85, np.inf, TRUTH, 20.0)))
    assert found[4] == pytest.approx(np.log(no_return_mass(np.inf, TRUTH)))


def test_a_cause_that_no_reading_shows_keeps_a_little_weight() -> None:
    only_hits = TRUTH.model_copy(update={"z_hit": 1.0, **dict.fromkeys(PARTS[1:], 0.0)})
    fit = fit_beam_model([drawn(2000, only_hits)], START)
    assert fit.config.z_max == pytest.approx(FLOOR, rel=0.02)
    assert fit.config.z_hit > 0.95


def test_logs_of_different_lasers_count_together() -> None:
    other = drawn(2000, seed=3)
    far = Readings(other.measured, other.expected, 80.0)
    fit = fit_beam_model([drawn(2000), far], START)
    assert fit.config.sigma_hit == pytest.approx(TRUTH.sigma_hit, rel=0.15)
