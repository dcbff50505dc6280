"""The normal distribution against scipy's."""

from __future__ import annotations

import numpy as np
from scipy import special

from pipeline.kernels import normal


def test_distribution() -> None:
    x = np.concatenate([np.linspace(-37, 12, 20_001), [-1e300, -np.inf, np.inf, 0.0]])
    found = np.empty_like(x)
    normal.distribution(x, found)
    np.testing.assert_allclose(found, special.ndtr(x), rtol=1e-12, atol=1e-300)


def test_quantiles() -> None:
    p = np.concatenate([np.logspace(-11, -0.31, 5000), 1.0 - np.logspace(-11, -0.31, 5000), [0.5]])
    found = np.empty_like(p)
    normal.quantiles(p, found)
    np.testing.assert_allclose(found, special.ndtri(p), rtol=1e-13, atol=1e-14)
