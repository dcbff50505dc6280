"""Backward simulation: past poses are drawn as often as they explain the present."""

from __future__ import annotations

import numpy as np
import pytest
import reference
from scipy import stats

from pipeline.kernels.random import stream_key, uniforms
from pipeline.kernels.smoothing import draw_predecessors

ONE = ((np.array([0.3, 0.02, 0.4]), np.array([0.2, 0.1, 0.15]), 1.0),)
TWO = (
    (np.array([0.3, 0.02, 0.4]), np.array([0.06, 0.05, 0.04]), 0.7),
    (np.array([0.1, -0.1, -0.2]), np.array([0.2, 0.1, 0.15]), 0.3),
)
BOTH = pytest.mark.parametrize("ways", [ONE, TWO], ids=["one way", "two ways"])
JUMP = 1e-3


def poses(n: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    drawn = rng.normal([5, 4, 3.0], [0.3, 0.2, 0.3], (n, 3))  # headings on both sides of the seam
    drawn[:, 2] = np.mod(drawn[:, 2] + np.pi, 2 * np.pi) - np.pi
    return drawn.astype(np.float32)


def drawn(particles, at, key, ways, *, weights=None, work: int = 0) -> np.ndarray:
    chosen = np.empty(len(at), np.int32)
    weights = np.full(len(particles), 0.1, np.float32) if weights is None else weights
    places, which = np.unique(at, axis=0, return_inverse=True)
    x, y, theta = np.ascontiguousarray(particles.T)
    moved, std, shares = (np.array(column) for column in zip(*ways, strict=True))
    draw_predecessors(work, x, y, theta, weights, places, which.reshape(-1), moved, std, shares, JUMP, key, chosen)
    return chosen


@BOTH
def test_agrees_with_the_twin(ways) -> None:
    particles, key = poses(200), stream_key(1, 2, 3)
    at = np.random.default_rng(1).normal([4.7, 4.0, -2.9], [0.2, 0.2, 0.2], (60, 3))
    chosen = drawn(particles, at, key, ways)
    for trajectory, (u, index) in enumerate(zip(uniforms(key, 60), chosen, strict=True)):
        share = reference.predecessor_densities(particles, at[trajectory], ways, JUMP)
        cumulative = np.cumsum(share) / share.sum()
        if np.abs(cumulative - u).min() > 1e-5:  # single precision may decide otherwise
            assert index == np.searchsorted(cumulative, u)
    np.testing.assert_array_equal(chosen, drawn(particles, at, key, ways, work=10**9))


@BOTH
def test_draws_have_the_right_frequencies(ways) -> None:
    particles, n = poses(8), 20_000
    at = np.repeat([[4.7, 4.0, -2.9]], n, axis=0)
    weights = np.linspace(0.5, 4.0, 8).astype(np.float32)
    counts = np.bincount(drawn(particles, at, stream_key(5, 5, 5), ways, weights=weights), minlength=8)
    share = weights * reference.predecessor_densities(particles, at[0], ways, JUMP)
    assert stats.chisquare(counts, n * share / share.sum()).pvalue > 1e-3


@BOTH
def test_a_kidnapped_robot_may_have_come_from_anywhere(ways) -> None:
    particles = poses(40)
    chosen = drawn(particles, np.repeat([[500.0, 0.0, 0.0]], 4000, axis=0), stream_key(1, 1, 1), ways)
    counts = np.bincount(chosen, minlength=40)
    assert stats.chisquare(counts).pvalue > 1e-3


def test_a_way_that_nobody_follows_changes_nothing() -> None:
    particles, key = poses(200), stream_key(1, 2, 3)
    at = np.random.default_rng(1).normal([4.7, 4.0, -2.9], [0.2, 0.2, 0.2], (60, 3))
    silent = (*ONE, (np.array([9.0, 9.0, 1.0]), np.array([5.0, 5.0, 5.0]), 0.0))
    np.testing.assert_array_equal(drawn(particles, at, key, ONE), drawn(particles, at, key, silent))
