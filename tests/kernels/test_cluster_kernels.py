"""Bins and clusters of particles, against dictionaries and a flood fill."""

from __future__ import annotations

import math

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.kernels import clusters

SIZE, TURNS = 0.5, 36
seeds = st.integers(0, 2**32 - 1)


class Binned:
    """What the kernels say of some particles, in buffers as the filter keeps them."""

    def __init__(self, poses, weights, floor: float = 0.0, slots: int | None = None) -> None:
        n = len(poses)
        self.columns, self.weights = np.ascontiguousarray(poses.T), weights
        table = np.empty((slots or 1 << int(2 * n).bit_length(), 2), np.int64)
        self.bin_of, self.parent = np.empty(n, np.int32), np.empty(n, np.int32)
        keys, bin_weights = np.empty(n, np.int64), np.empty(n)
        self.bins = clusters.occupied_bins(*self.columns, weights, SIZE, TURNS, table, self.bin_of, keys, bin_weights)
        if self.bins < 0:
            return
        self.bin_weights, heavy = bin_weights[: self.bins], np.empty(n, np.int32)
        m = clusters.join_bins(TURNS, table, keys[: self.bins], self.bin_weights, floor, heavy, self.parent)
        self.heavy, self.parent = heavy[:m], self.parent[: self.bins]

    def groups(self) -> set[frozenset[int]]:
        """Clusters as sets of bins."""
        roots = np.unique(self.parent[self.parent >= 0])
        return {frozenset(np.flatnonzero(self.parent == root).tolist()) for root in roots}

    def ranked(self) -> tuple[int, np.ndarray]:
        row_of_bin = np.empty(self.bins, np.int32)
        share = np.empty(self.bins)
        return clusters.heaviest_clusters(self.heavy, self.parent, self.bin_weights, share, row_of_bin), row_of_bin


def crowd(rng, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Some haze, and heaps of which some touch; on both sides of the origin and of the heading's seam."""
    centres = rng.uniform([-4, -4, -np.pi], [4, 4, np.pi], (4, 3))
    poses = centres[rng.integers(4, size=n)] + rng.normal(0, [0.5, 0.5, 0.3], (n, 3))
    haze = rng.random(n) < 0.2
    poses[haze] = rng.uniform([-6, -6, -np.pi], [6, 6, np.pi], (int(haze.sum()), 3))
    poses[:, 2] = np.mod(poses[:, 2] + np.pi, 2 * np.pi) - np.pi
    weights = rng.exponential(size=n)
    return poses.astype(np.float32), weights / weights.sum()


@given(seeds, st.integers(1, 250), st.sampled_from([0.0, 0.1, 0.5]))
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
        assert binned.bin_weights[bin_number] == pytest.approx(weight)
    assert len(set(number.values())) == len(expected)
    least = floor * max(weight for weight, _ in expected.values())
    groups = {frozenset(number[key] for key in group) for group in reference.clusters(expected, TURNS, least)}
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
    k, row_of_bin = binned.ranked()
    assert k == len(binned.groups())
    if k > 1:
        row_of_bin[row_of_bin == k // 2] = -1  # one that nobody asks about
    sums = np.empty((k, clusters.MOMENTS))
    clusters.cluster_moments(*binned.columns, weights, binned.bin_of, row_of_bin, sums)
    for row in range(k):
        members = row_of_bin[binned.bin_of] == row
        if not members.any():
            assert not sums[row].any()
            continue
        weight, mean, covariance = reference.moments(poses[members], weights[members])
        s = sums[row]
        delta = s[4:7] / s[0]
        second = np.empty((3, 3))
        second[np.triu_indices(3)] = s[7:13] / s[0]
        second.T[np.triu_indices(3)] = second[np.triu_indices(3)]
        assert s[0] == pytest.approx(weight)
        np.testing.assert_allclose(s[1:4] + delta, mean, atol=1e-5)
        np.testing.assert_allclose(second - np.outer(delta, delta), covariance, atol=1e-5)


@given(seeds, st.integers(1, 250))
@settings(max_examples=25, deadline=None)
def test_the_heaviest_clusters_come_first(seed: int, n: int) -> None:
    binned = Binned(*crowd(np.random.default_rng(seed), n))
    k, row_of_bin = binned.ranked()
    shares = sorted((binned.bin_weights[list(group)].sum() for group in binned.groups()), reverse=True)
    assert k == min(len(shares), clusters.MOST)
    found = [binned.bin_weights[row_of_bin == row].sum() for row in range(k)]
    np.testing.assert_allclose(found, shares[:k])


def test_a_table_that_is_half_full_is_too_small() -> None:
    poses = np.zeros((40, 3), np.float32)
    poses[:, 0] = np.arange(40)
    assert Binned(poses, np.full(40, 1 / 40), slots=64).bins == -1
    assert Binned(poses, np.full(40, 1 / 40), slots=128).bins == 40


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
