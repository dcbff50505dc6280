"""Elementary functions against the library's, and angles brought within a turn."""

from __future__ import annotations

import math

import numpy as np

from pipeline.kernels import kernel
from pipeline.kernels.elementary import exponential, sine_cosine, wrapped


@kernel
def all_of_them(angles, sines, cosines, within):
    for i in range(len(angles)):
        sines[i], cosines[i] = sine_cosine(angles[i])
        within[i] = wrapped(angles[i])


def evaluated(angles) -> list[np.ndarray]:
    angles = np.asarray(angles, np.float32)
    out = [np.empty_like(angles) for _ in range(3)]
    all_of_them(angles, *out)
    return out


def test_sine_and_cosine() -> None:
    """Within one and a half of the last digits of single precision, also many turns away."""
    for reach in (math.pi, 40.0, 700.0):
        angles = np.linspace(-reach, reach, 300_001).astype(np.float32)
        sines, cosines, _ = evaluated(angles)
        assert np.abs(sines - np.sin(angles.astype(float))).max() < 1.2e-7
        assert np.abs(cosines - np.cos(angles.astype(float))).max() < 1.2e-7


def test_quarter_turns() -> None:
    sines, cosines, _ = evaluated(np.arange(-8, 9) * math.pi / 2)
    np.testing.assert_allclose(sines, np.sin(np.arange(-8, 9) * math.pi / 2), atol=1e-6)
    np.testing.assert_allclose(cosines, np.cos(np.arange(-8, 9) * math.pi / 2), atol=1e-6)


def test_wrapped() -> None:
    border = np.float32(math.pi)
    at_border = np.array([border, -border, np.nextafter(border, 9), np.nextafter(-border, -9)], np.float32)
    angles = np.concatenate([np.linspace(-100, 100, 100_001), at_border]).astype(np.float32)
    within = evaluated(angles)[2]
    assert within.min() >= -border
    assert within.max() < border
    apart = np.angle(np.exp(1j * (within.astype(float) - angles.astype(float))))
    assert np.abs(apart).max() < 5e-7


@kernel
def exponentials(x, out):
    for i in range(len(x)):
        out[i] = exponential(x[i])


def test_exponential() -> None:
    """As near as it says; nothing far below, and one at 0."""
    x = np.append(np.linspace(-59.9, 0.0, 100_001), [-61.0, -1e9, -np.inf]).astype(np.float32)
    out = np.empty_like(x)
    exponentials(x, out)
    exact = np.exp(x[:-3].astype(float))
    np.testing.assert_allclose(out[:-3], exact, rtol=0, atol=5e-6)
    np.testing.assert_allclose(out[:-3][x[:-3] > -30], exact[x[:-3] > -30], rtol=2e-3)
    np.testing.assert_allclose(out[:-3][x[:-3] > -10], exact[x[:-3] > -10], rtol=1e-5)
    assert out[100_000] == 1.0
    assert not out[-3:].any()
