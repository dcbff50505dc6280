"""Drawing ancestors, against combs and draws made one at a time."""

from __future__ import annotations

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.kernels import BLOCK, resampling

weight_lists = st.lists(st.one_of(st.just(0.0), st.floats(1e-6, 1.0)), min_size=1, max_size=40).filter(
    lambda w: sum(w) > 0
)


def normalised(values) -> np.ndarray:
    return np.array(values, float) / np.sum(values)


def comb(weights, start: float, m: int, work: int = 0) -> np.ndarray:
    """``low_variance``, with what it works in."""
    out = np.full(m, -1, np.int32)
    resampling.low_variance(work, weights, start, np.empty(-(-len(weights) // BLOCK) + 1), out)
    return out


@given(weight_lists, st.floats(0, 1, exclude_max=True), st.integers(1, 60))
@settings(deadline=None)
def test_low_variance(values, start: float, m: int) -> None:
    weights = normalised(values)
    out = comb(weights, start, m)
    assert out.tolist() == reference.low_variance(weights, start, m)
    assert (weights[out] > 0).all()
    counts = np.bincount(out, minlength=len(weights))
    # The comb's teeth are 1/m apart: a weight gets the floor or the ceiling of its share.
    assert (counts >= np.floor(m * weights - 1e-9)).all()
    assert (counts <= np.ceil(m * weights + 1e-9)).all()


@given(weight_lists, st.integers(0, 2**32 - 1), st.integers(1, 60))
@settings(deadline=None)
def test_multinomial(values, seed: int, m: int) -> None:
    weights, out = normalised(values), np.empty(m, np.int32)
    draws = np.sort(np.random.default_rng(seed).random(m))
    resampling.multinomial(weights, draws, out)
    assert out.tolist() == reference.multinomial(weights, draws)
    assert (weights[out] > 0).all()


def test_rounding_of_the_sum_lets_no_dead_particle_survive() -> None:
    weights = np.full(1000, 1e-3)
    weights[-300:] = 0.0
    weights /= weights.sum()
    weights *= 1 - 1e-9  # the sum stays below the last tooth
    for start in (0.0, 0.5, 1 - 2**-53):
        out = comb(weights, start, 777)
        assert out.max() == 699
    resampling.multinomial(weights, np.full(777, 1 - 2**-53), out)
    assert set(out.tolist()) == {699}


@pytest.mark.parametrize("dead", ["none", "many", "whole blocks", "the end"])
@pytest.mark.parametrize("m", [100, 3 * BLOCK, 50_000])
def test_low_variance_in_blocks(dead: str, m: int) -> None:
    """Blocks are drawn from side by side; where their sums round otherwise, a survivor may be its neighbour's."""
    rng = np.random.default_rng(m)
    weights = rng.exponential(size=4 * BLOCK + 77)
    if dead == "many":
        weights[rng.random(len(weights)) < 0.9] = 0.0
    elif dead == "whole blocks":
        weights[BLOCK : 3 * BLOCK] = 0.0
    elif dead == "the end":
        weights[2 * BLOCK + 5 :] = 0.0
    weights = normalised(weights)
    for start in (0.0, 0.37, 1 - 2**-53):
        out = comb(weights, start, m)
        np.testing.assert_array_equal(out, comb(weights, start, m, work=10**9))
        assert (weights[out] > 0).all()
        assert (np.diff(out) >= 0).all()
        cumulative = np.cumsum(weights)
        expected = np.searchsorted(cumulative, (start + np.arange(m)) / m, side="right")
        near = np.abs(cumulative[out] - (start + np.arange(m)) / m) < 1e-12
        assert ((out == expected) | near | (expected == len(weights))).all()


def test_weights_that_begin_with_zero() -> None:
    weights, out = np.array([0.0, 0.0, 1.0, 0.0]), np.empty(5, np.int32)
    assert comb(weights, 0.0, 5).tolist() == [2] * 5
    resampling.multinomial(weights, np.zeros(5), out)
    assert out.tolist() == [2] * 5


def test_gather() -> None:
    rng = np.random.default_rng(0)
    source = rng.random((3, 500)).astype(np.float32)
    ancestors = rng.integers(0, 500, 800).astype(np.int32)
    for work in (0, 10**9):
        out = np.empty((3, 800), np.float32)
        resampling.gather(work, source, ancestors, out)
        np.testing.assert_array_equal(out, source[:, ancestors])
