"""Weights, sums and frames of particles, against numpy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.kernels import BLOCK, belief

seeds = st.integers(0, 2**32 - 1)


def blocks(n: int) -> int:
    return -(-n // BLOCK)


def weighed(start, gain, temper: float = 1.0, work: int = 0):
    """Log-weights, weights, log of their former sum and effective sample size."""
    log_weights, weights = np.array(start, float), np.empty(len(start))
    buffers = np.empty(blocks(len(start))), np.empty((blocks(len(start)), 2))
    log_total, ess = belief.weigh(work, log_weights, np.asarray(gain, np.float32), temper, weights, *buffers)
    return log_weights, weights, log_total, ess


@pytest.mark.parametrize("n", [1, BLOCK, BLOCK + 1, 30_000])
def test_weights_from_likelihoods(n: int) -> None:
    """One particle in a block of its own, whole blocks, and one more: in log space and normalised."""
    rng = np.random.default_rng(n)
    start, gain = rng.normal(-10, 5, n), rng.normal(-40, 20, n).astype(np.float32)
    expected = start + 0.3 * gain.astype(float)
    total = np.logaddexp.reduce(expected)
    expected -= total
    log_weights, weights, log_total, ess = weighed(start, gain, 0.3)
    np.testing.assert_allclose(log_weights, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(weights, np.exp(expected), rtol=1e-9, atol=1e-300)
    assert log_total == pytest.approx(total)
    assert ess == pytest.approx(1 / np.sum(np.exp(2 * expected)))
    for one, all_threads in zip((log_weights, weights), weighed(start, gain, 0.3, 10**9), strict=False):
        np.testing.assert_array_equal(one, all_threads)


def test_likelihoods_too_small_for_a_double() -> None:
    _, weights, log_total, _ = weighed([-2000.0, -2001.0, -9000.0], np.zeros(3))
    e = math.exp(-1)
    np.testing.assert_allclose(weights, [1 / (1 + e), e / (1 + e), 0.0])
    assert log_total == pytest.approx(-2000.0 + math.log(1 + e))


def test_a_block_of_the_hopeless_beside_another_one() -> None:
    """Every block is weighed against its own best, and then all against the best of all."""
    start = np.concatenate([np.full(BLOCK, -5000.0), [-3.0], np.full(BLOCK - 1, -math.inf)])
    log_weights, weights, _, ess = weighed(start, np.zeros(2 * BLOCK))
    assert weights[BLOCK] == pytest.approx(1.0)
    assert weights.sum() == pytest.approx(1.0)
    assert ess == pytest.approx(1.0)
    assert log_weights[0] == pytest.approx(-4997.0)


@pytest.mark.parametrize("n", [1, 5000])
def test_sums(n: int) -> None:
    rng = np.random.default_rng(n)
    x, y = rng.normal(5, 9, (2, n)).astype(np.float32)
    weights = rng.random(n)
    for work in (0, 10**9):
        sums = np.empty(blocks(n))
        belief.weighted_sum(work, x, weights, sums)
        assert sums.sum() == pytest.approx(np.sum(weights * x.astype(float)))
        belief.squared_distance(work, x, y, 1.5, -2.5, weights, sums)
        expected = np.sum(weights * ((x.astype(float) - 1.5) ** 2 + (y.astype(float) + 2.5) ** 2))
        assert sums.sum() == pytest.approx(expected, rel=1e-6)


@given(st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.14, 3.14)), seeds)
@settings(max_examples=25, deadline=None)
def test_to_map(origin, seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses = rng.uniform([0, 0, -np.pi], [50, 50, np.pi], (60, 3)).astype(np.float32)
    out, again = np.empty((60, 3), np.float32), np.empty((60, 3), np.float32)
    belief.to_map(0, *np.ascontiguousarray(poses.T), *origin, out)
    belief.to_map(10**9, *np.ascontiguousarray(poses.T), *origin, again)
    np.testing.assert_array_equal(out, again)
    cos, sin = math.cos(origin[2]), math.sin(origin[2])
    at = poses[:, :2].astype(float) @ np.array([[cos, sin], [-sin, cos]]) + origin[:2]
    np.testing.assert_allclose(out[:, :2], at, atol=2e-5)
    turn = np.exp(1j * (poses[:, 2].astype(float) + origin[2]))
    np.testing.assert_allclose(np.exp(1j * out[:, 2].astype(float)), turn, atol=1e-5)
    assert np.abs(out[:, 2]).max() <= np.float32(np.pi)
