"""Random streams: evenly spread, independent of each other, the same on every run."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from pipeline.kernels.random import normal_quantiles, stream_key, uniforms


@given(st.integers(-(2**63), 2**63 - 1), st.integers(0, 2**31), st.integers(0, 9))
@settings(max_examples=30, deadline=None)
def test_numbers_are_those_of_the_twin(seed: int, scan: int, purpose: int) -> None:
    key = stream_key(seed, scan, purpose)
    np.testing.assert_array_equal(uniforms(key, 20), reference.uniforms(int(key), 20))


def test_known_answer() -> None:
    # The first outputs of SplitMix64 seeded with 1234567, as published with the generator.
    known = [6457827717110365317, 3203168211198807973, 9817491932198370423]
    assert [reference.random_bits(1234567, i) for i in range(3)] == known
    expected = [(z >> 11) / 2**53 for z in known]
    assert uniforms(np.uint64(1234567), 3).tolist() == expected


@pytest.mark.parametrize("seed", [0, 1, 12345])
def test_uniform(seed: int) -> None:
    u = uniforms(stream_key(seed, 3, 1), 100_000)
    assert u.min() >= 0.0
    assert u.max() < 1.0
    assert stats.kstest(u, "uniform").pvalue > 1e-3
    counts = np.bincount((u * 100).astype(int), minlength=100)
    assert stats.chisquare(counts).pvalue > 1e-3
    assert abs(np.corrcoef(u[1:], u[:-1])[0, 1]) < 0.015  # neighbouring particles know nothing of each other


def test_streams_are_independent() -> None:
    """Neighbouring seeds, scans and purposes, and swapped ones: 4.5 standard deviations of a correlation of nothing."""
    n = 50_000
    parts = [
        (0, 0, 0),
        (0, 0, 1),
        (0, 1, 0),
        (1, 0, 0),
        (0, 1, 1),
        (1, 1, 0),
        (1, 0, 1),
        (0, 2, 0),
        (2, 0, 0),
        (-1, 0, 0),
    ]
    streams = np.stack([uniforms(stream_key(*p), n) for p in parts])
    correlation = np.corrcoef(streams) - np.eye(len(parts))
    assert np.abs(correlation).max() < 4.5 / np.sqrt(n)
    for lag in (1, 2, 17):
        for a, b in itertools.permutations(range(len(parts)), 2):
            assert abs(np.corrcoef(streams[a, lag:], streams[b, :-lag])[0, 1]) < 4.5 / np.sqrt(n)


def test_keys_do_not_collide() -> None:
    keys = {int(stream_key(seed, scan, purpose)) for seed in range(20) for scan in range(200) for purpose in range(5)}
    assert len(keys) == 20 * 200 * 5


def test_same_key_same_numbers() -> None:
    key = stream_key(7, 8, 2)
    np.testing.assert_array_equal(uniforms(key, 1000), uniforms(key, 1000))
    np.testing.assert_array_equal(uniforms(key, 10), uniforms(key, 1000)[:10])  # a function of the index alone


def test_normal_quantiles_have_the_moments_of_a_normal() -> None:
    q = normal_quantiles().astype(float)
    assert q.shape == (65536,)
    assert (np.diff(q) > 0).all()
    np.testing.assert_allclose(q, -q[::-1], atol=1e-6)
    assert q.mean() == pytest.approx(0.0, abs=1e-6)
    assert q.std() == pytest.approx(1.0, abs=1e-4)  # what is cut off beyond 4.3 deviations weighs so little
    assert np.mean(q**4) == pytest.approx(3.0, abs=5e-3)
    assert 4.2 < q[-1] < 4.4
    assert q[int(0.975 * 65536)] == pytest.approx(1.95996, abs=1e-3)
