"""Sums, bins and clusters of particles, against dictionaries and a flood fill."""

from __future__ import annotations

import math

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.kernels import belief

SIZE, TURNS = 0.5, 36
seeds = st.integers(0, 2**32 - 1)


def blocks(n: int) -> int:
    return -(-n // belief.BLOCK)


@pytest.mark.parametrize("n", [1, 4096, 4097, 30_000])
def test_weights_from_likelihoods(n: int) -> None:
    """Two particles in a block of their own, whole blocks, and one more: in log space and normalised."""
    rng = np.random.default_rng(n)
    start, gain = rng.normal(-10, 5, n), rng.normal(-40, 20, n).astype(np.float32)
    expected = start + 0.3 * gain.astype(float)
    expected -= np.logaddexp.reduce(expected)
    results = []
    for work in (0, 10**9):
        log_weights, weights = start.copy(), np.empty(n)
        largest, sums = np.empty(blocks(n)), np.empty((blocks(n), 2))
        belief.add_likelihood(work, log_weights, gain, 0.3, largest)
        assert largest.max() == log_weights.max()
        belief.exponentiate(work, log_weights, float(largest.max()), weights, sums)
        total, squares = sums.sum(axis=0)
        belief.rescale(work, log_weights, weights, float(largest.max()) + math.log(total), 1 / total, blocks(n))
        np.testing.assert_allclose(log_weights, expected, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(weights, np.exp(expected), rtol=1e-9, atol=1e-300)
        assert squares / total**2 == pytest.approx(np.sum(np.exp(2 * expected)))
        results.append((log_weights, weights, sums))
    for one, all_threads in zip(*results, strict=True):
        np.testing.assert_array_equal(one, all_threads)


def test_likelihoods_too_small_for_a_double() -> None:
    log_weights, weights = np.array([-2000.0, -2001.0, -9000.0]), np.empty(3)
    largest, sums = np.empty(1), np.empty((1, 2))
    belief.add_likelihood(0, log_weights, np.zeros(3, np.float32), 1.0, largest)
    belief.exponentiate(0, log_weights, float(largest[0]), weights, sums)
    np.testing.assert_allclose(weights, [1.0, math.exp(-1), 0.0])


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


class Binned:
    """What the kernels say of some particles, in buffers as the filter keeps them."""

    def __init__(self, poses, weights, floor: float = 0.0) -> None:
        n = len(poses)
        self.columns = np.ascontiguousarray(poses.T)
        size = 1 << int(2 * n).bit_length()
        self.keys, self.bin_at = np.empty(size, np.int64), np.empty(size, np.int32)
        self.bin_of, self.bin_key, self.bin_weight = np.empty(n, np.int32), np.empty(n, np.int64), np.empty(n)
        self.weights = weights
        hashed = self.keys, self.bin_at
        self.bins = belief.occupied_bins(
            *self.columns, weights, SIZE, TURNS, *hashed, self.bin_of, self.bin_key, self.bin_weight
        )
        self.parent = np.empty(n, np.int32)
        belief.label_bins(self.bins, TURNS, *hashed, self.bin_key, self.bin_weight, floor, self.parent)

    def groups(self) -> set[frozenset[int]]:
        """Clusters as sets of bins."""
        parent = self.parent[: self.bins]
        return {frozenset(np.flatnonzero(parent == root).tolist()) for root in np.unique(parent[parent >= 0])}


def crowd(rng, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Some haze, and heaps of which some touch; on both sides of the origin and of the heading's seam."""
    centres = rng.uniform([-4, -4, -np.pi], [4, 4, np.pi], (4, 3))
    poses = centres[rng.integers(4, size=n)] + rng.normal(0, [0.5, 0.5, 0.3], (n, 3))
    haze = rng.random(n) < 0.2
    poses[haze] = rng.uniform([-6, -6, -np.pi], [6, 6, np.pi], (int(haze.sum()), 3))
    poses[:, 2] = np.mod(poses[:, 2] + np.pi, 2 * np.pi) - np.pi
    weights = rng.exponential(size=n)
    return poses.astype(np.float32), weights / weights.sum()


@given(seeds, st.integers(1, 250), st.sampled_from([0.0, 0.005, 0.02]))
@settings(max_examples=40, deadline=None)
def test_bins_and_clusters(seed: int, n: int, floor: float) -> None:
    poses, weights = crowd(np.random.default_rng(seed), n)
    binned = Binned(poses, weights, floor)
    expected = reference.bins(poses, weights, SIZE, TURNS)

    assert binned.bins == len(expected)
    number = {}
    for key, (weight, members) in expected.items():
        (bin_number,) = set(binned.bin_of[members].tolist())
        number[key] = bin_number
        assert binned.bin_weight[bin_number] == pytest.approx(weight)
    assert len(set(number.values())) == len(expected)
    groups = {frozenset(number[key] for key in group) for group in reference.clusters(expected, TURNS, floor)}
    assert binned.groups() == groups


@given(seeds, st.integers(1, 250))
@settings(max_examples=25, deadline=None)
def test_moments(seed: int, n: int) -> None:
    """Of heaps less than half a turn wide: a mean heading of everything has no meaning, and no twin."""
    rng = np.random.default_rng(seed)
    centres = np.array([[0.0, 0.0, 3.1], [40.0, -3.0, 0.2], [-9.0, 7.0, -1.5]])[rng.integers(3, size=n)]
    poses = centres + rng.normal(0, [0.3, 0.3, 0.1], (n, 3))
    poses[:, 2] = np.mod(poses[:, 2] + np.pi, 2 * np.pi) - np.pi
    poses, weights = poses.astype(np.float32), normalised(rng.exponential(size=n))
    binned = Binned(poses, weights)
    roots = np.unique(binned.parent[: binned.bins])
    slot_of_root = np.full(binned.bins, -1, np.int32)
    slot_of_root[roots] = np.arange(len(roots))
    slot_of_root[roots[len(roots) // 2]] = -1  # one that nobody asks about
    sums = np.zeros((len(roots), 16))
    belief.cluster_moments(*binned.columns, weights, binned.bin_of, binned.parent, slot_of_root, sums)
    for slot, root in enumerate(roots):
        if slot_of_root[root] < 0:
            assert not sums[slot].any()
            continue
        members = binned.parent[binned.bin_of] == root
        weight, mean, covariance = reference.moments(poses[members], weights[members])
        s = sums[slot]
        delta = s[4:7] / s[0]
        second = np.empty((3, 3))
        second[np.triu_indices(3)] = s[7:13] / s[0]
        second.T[np.triu_indices(3)] = second[np.triu_indices(3)]
        assert s[0] == pytest.approx(weight)
        np.testing.assert_allclose(s[1:4] + delta, mean, atol=1e-5)
        np.testing.assert_allclose(second - np.outer(delta, delta), covariance, atol=1e-5)


def normalised(values) -> np.ndarray:
    return values / values.sum()


def test_bins_far_from_the_origin() -> None:
    """A map frame may have its origin in another town: 200 km at bins of half a metre."""
    poses = np.array([[2e5, -2e5, 0.0], [2e5, -2e5, 0.01], [-2e5, 2e5, 0.0], [0.1, 0.1, 0.0], [-0.1, -0.1, 0.0]])
    binned = Binned(poses.astype(np.float32), np.full(5, 0.2))
    assert binned.bins == 4
    assert binned.groups() == {frozenset({0}), frozenset({1}), frozenset({2, 3})}


def test_headings_are_neighbours_across_the_seam() -> None:
    poses = np.array([[0.1, 0.1, math.pi - 0.01], [0.1, 0.1, -math.pi + 0.01], [0.1, 0.1, 0.0]], np.float32)
    binned = Binned(poses, np.full(3, 1 / 3))
    assert binned.groups() == {frozenset({0, 1}), frozenset({2})}


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
