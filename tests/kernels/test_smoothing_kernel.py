"""Backward simulation: past poses are drawn as often as they explain the present."""

from __future__ import annotations

import numpy as np
import reference
from scipy import stats

from pipeline.kernels.random import stream_key, uniforms
from pipeline.kernels.smoothing import draw_predecessors

MOVED, STD, JUMP = np.array([0.3, 0.02, 0.4]), np.array([0.2, 0.1, 0.15]), 1e-3


def poses(n: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    drawn = rng.normal([5, 4, 3.0], [0.3, 0.2, 0.3], (n, 3))  # headings on both sides of the seam
    drawn[:, 2] = np.mod(drawn[:, 2] + np.pi, 2 * np.pi) - np.pi
    return drawn.astype(np.float32)


def drawn(particles, at, key, *, weights=None, work: int = 0) -> np.ndarray:
    chosen = np.empty(len(at), np.int32)
    weights = np.full(len(particles), 0.1, np.float32) if weights is None else weights
    places, which = np.unique(at, axis=0, return_inverse=True)
    x, y, theta = np.ascontiguousarray(particles.T)
    draw_predecessors(work, x, y, theta, weights, places, which.reshape(-1), MOVED, STD, JUMP, key, chosen)
    return chosen


def test_agrees_with_the_twin() -> None:
    particles, key = poses(200), stream_key(1, 2, 3)
    at = np.random.default_rng(1).normal([4.7, 4.0, -2.9], [0.2, 0.2, 0.2], (60, 3))
    chosen = drawn(particles, at, key)
    for trajectory, (u, index) in enumerate(zip(uniforms(key, 60), chosen, strict=True)):
        share = reference.predecessor_densities(particles, at[trajectory], MOVED, STD, JUMP)
        cumulative = np.cumsum(share) / share.sum()
        if np.abs(cumulative - u).min() > 1e-5:  # single precision may decide otherwise
            assert index == np.searchsorted(cumulative, u)
    np.testing.assert_array_equal(chosen, drawn(particles, at, key, work=10**9))


def test_draws_have_the_right_frequencies() -> None:
    particles, n = poses(8), 20_000
    at = np.repeat([[4.7, 4.0, -2.9]], n, axis=0)
    weights = np.linspace(0.5, 4.0, 8).astype(np.float32)
    counts = np.bincount(drawn(particles, at, stream_key(5, 5, 5), weights=weights), minlength=8)
    share = weights * reference.predecessor_densities(particles, at[0], MOVED, STD, JUMP)
    assert stats.chisquare(counts, n * share / share.sum()).pvalue > 1e-3


def test_a_kidnapped_robot_may_have_come_from_anywhere() -> None:
    particles = poses(40)
    chosen = drawn(particles, np.repeat([[500.0, 0.0, 0.0]], 4000, axis=0), stream_key(1, 1, 1))
    counts = np.bincount(chosen, minlength=40)
    assert stats.chisquare(counts).pvalue > 1e-3
