"""Hypotheses: heaps of particles, told apart, each with its own mean and covariance."""

from __future__ import annotations

import math

import numpy as np
import pytest
import reference

from pipeline.filter.estimate import Clusters
from pipeline.geometry import wrap_angle
from pipeline.maps.occupancy_grid import OccupancyGrid

PLACES = np.array([[4.0, 5.0, 0.3], [16.0, 5.0, 3.1], [9.0, 14.0, -1.0]])


def grid(origin=(0.0, 0.0, 0.0)) -> OccupancyGrid:
    return OccupancyGrid(np.zeros((200, 200), np.float32), 0.1, origin)


def heaps(counts, std=(0.2, 0.1, 0.05)) -> tuple[np.ndarray, np.ndarray]:
    """Poses (3, n), and which heap each belongs to."""
    rng = np.random.default_rng(0)
    heap = np.repeat(np.arange(len(counts)), counts)
    poses = PLACES[heap] + rng.normal(0, std, (len(heap), 3))
    poses[:, 2] = wrap_angle(poses[:, 2])
    order = rng.permutation(len(heap))
    return np.ascontiguousarray(poses[order].T.astype(np.float32)), heap[order]


def find(poses, weights, g=None):
    return Clusters(g or grid(), len(weights)).find(poses, weights)


def test_two_places_have_two_estimates_and_no_mean() -> None:
    poses, heap = heaps([600, 400])
    first, second = find(poses, np.full(1000, 1e-3))[:2]
    np.testing.assert_allclose(first.pose, PLACES[0], atol=0.05)
    np.testing.assert_allclose(second.pose[:2], PLACES[1][:2], atol=0.05)
    assert abs(wrap_angle(second.pose[2] - PLACES[1][2])) < 0.02  # a heap on both sides of the seam
    assert first.weight == pytest.approx(0.6, abs=0.03)
    assert second.weight == pytest.approx(0.4, abs=0.03)
    assert np.count_nonzero(heap == 0) == 600


def test_the_heaviest_is_first_however_few_its_particles() -> None:
    poses, heap = heaps([900, 60, 40])
    weights = np.array([0.2, 0.5, 0.3])[heap] / np.array([900, 60, 40])[heap]
    found = find(poses, weights)
    np.testing.assert_allclose([e.pose[:2] for e in found[:3]], PLACES[[1, 2, 0], :2], atol=0.15)
    assert sorted((e.weight for e in found), reverse=True) == [e.weight for e in found]
    assert sum(e.weight for e in found) <= 1 + 1e-9


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (30.0, -20.0, 0.8), (0.0, 0.0, math.pi)])
def test_moments_in_the_map_frame(origin) -> None:
    """Of one heap, in which no bin is too light to count: the weighted mean and covariance, turned into the map."""
    rng = np.random.default_rng(3)
    poses = (np.array([4.25, 5.25, 0.3]) + rng.uniform(-0.2, 0.2, (500, 3)) * [1, 1, 0.2]).astype(np.float32)
    weights = rng.exponential(size=500)
    weights /= weights.sum()
    g = grid(origin)
    (found,) = find(np.ascontiguousarray(poses.T), weights, g)
    in_map = g.to_map(poses)
    weight, mean, covariance = reference.moments(in_map, weights)
    assert found.weight == pytest.approx(weight)
    np.testing.assert_allclose(found.pose[:2], mean[:2], atol=1e-5)
    assert abs(wrap_angle(found.pose[2] - mean[2])) < 1e-5
    np.testing.assert_allclose(found.covariance, covariance, atol=1e-6)
    assert -math.pi <= found.pose[2] < math.pi


def test_a_thin_haze_does_not_connect_two_places() -> None:
    poses, _ = heaps([500, 500])
    rng = np.random.default_rng(1)
    haze = np.stack([rng.uniform(0, 20, 4000), rng.uniform(0, 20, 4000), rng.uniform(-3.1, 3.1, 4000)])
    weights = np.concatenate([np.full(1000, 0.98 / 1000), np.full(4000, 0.02 / 4000)])
    found = find(np.ascontiguousarray(np.hstack([poses, haze.astype(np.float32)])), weights)
    assert [round(e.weight, 1) for e in found[:2]] == [0.5, 0.5]
    for estimate in found[:2]:
        assert np.hypot(*(estimate.pose - PLACES[:2])[:, :2].T).min() < 0.1


def test_one_particle() -> None:
    (found,) = find(np.array([[1.0], [2.0], [-3.0]], np.float32), np.ones(1))
    np.testing.assert_allclose(found.pose, [1, 2, -3], atol=1e-6)
    np.testing.assert_allclose(found.covariance, 0, atol=1e-9)


def test_buffers_may_be_used_again() -> None:
    clusters = Clusters(grid(), 1000)
    poses, _ = heaps([600, 400])
    before = clusters.find(poses, np.full(1000, 1e-3))
    clusters.find(np.ascontiguousarray(poses[:, :7]), np.full(7, 1 / 7))
    again = clusters.find(poses, np.full(1000, 1e-3))
    for a, b in zip(before, again, strict=True):
        np.testing.assert_array_equal(a.pose, b.pose)
        np.testing.assert_array_equal(a.covariance, b.covariance)
