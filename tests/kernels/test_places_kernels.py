"""Rows of particles, against numpy row by row."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.kernels import places


def test_weights() -> None:
    rng = np.random.default_rng(0)
    before = rng.random((5, 70))
    before /= before.sum(axis=1, keepdims=True)
    gain = rng.normal(-300, 40, (5, 70)).astype(np.float32)
    gain[3] -= 1e6  # a place that explains nothing is weighed against itself
    weights, ess = before.copy(), np.empty(5)
    places.weigh(weights, gain, 0.2, ess)
    for row in range(5):
        log = np.log(before[row]) + 0.2 * gain[row].astype(float)
        expected = np.exp(log - np.logaddexp.reduce(log))
        np.testing.assert_allclose(weights[row], expected, rtol=1e-6, atol=1e-290)
        assert ess[row] == pytest.approx(1 / np.square(expected).sum(), rel=1e-6)
    assert (weights > 0).all()


def test_mean_poses() -> None:
    """Headings on both sides of the seam have their mean at the seam."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, 50, (2, 4, 60)).astype(np.float32)
    spread = rng.normal(0, 0.2, (4, 60))
    theta = np.angle(np.exp(1j * (np.array([[0.0], [3.1], [-3.1], [1.5]]) + spread))).astype(np.float32)
    weights = rng.random((4, 60))
    weights /= weights.sum(axis=1, keepdims=True)
    out = np.empty((4, 3))
    places.mean_poses(x, y, theta, weights, out)
    np.testing.assert_allclose(out[:, 0], (weights * x).sum(axis=1))
    np.testing.assert_allclose(out[:, 1], (weights * y).sum(axis=1))
    direction = (weights * np.exp(1j * theta.astype(float))).sum(axis=1)
    np.testing.assert_allclose(out[:, 2], np.angle(direction))
