"""Moving particles: Table 5.6 with its noise, against the twin."""

from __future__ import annotations

import math

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.geometry import between
from pipeline.kernels.motion import SHARES, followed, move
from pipeline.kernels.random import normal_quantiles, stream_key

QUANTILES = normal_quantiles()


def moved(poses, motion, std, key, *, work: int = 0) -> np.ndarray:
    x, y, theta = np.ascontiguousarray(np.asarray(poses, np.float32).T)
    way = by_wheels(motion, std)
    move(work, x, y, theta, np.array([way], np.float32), np.zeros(SHARES, np.int32), key, QUANTILES)
    return np.column_stack([x, y, theta])


def by_wheels(motion, std) -> tuple[float, ...]:
    """A way to move by Table 5.6: turn, drive, turn."""
    rot1, trans, rot2 = motion
    return (rot1, std[0], trans, 0.0, std[1], 0.0, 0.0, 0.0, rot2, 0.0, 0.0, std[2])


def random_poses(rng, n: int) -> np.ndarray:
    return rng.uniform([0, 0, -np.pi], [40, 40, np.pi], (n, 3)).astype(np.float32)


def difference(a, b) -> float:
    d = np.asarray(a, float) - b
    d[:, 2] = np.mod(d[:, 2] + np.pi, 2 * np.pi) - np.pi
    return float(np.abs(d).max())


@given(
    st.integers(0, 2**32 - 1),
    st.tuples(st.floats(-1.5, 1.5), st.floats(-2, 2), st.floats(-3.1, 3.1)),
    st.tuples(st.floats(0, 0.2), st.floats(0, 0.3), st.floats(0, 0.2)),
)
@settings(max_examples=40, deadline=None)
def test_agrees_with_the_twin(seed: int, motion, std) -> None:
    poses = random_poses(np.random.default_rng(seed), 30)
    key = stream_key(seed, 1, 1)
    expected = reference.move(poses, motion, std, int(key), QUANTILES)
    assert difference(moved(poses, motion, std, key), expected) < 2e-5  # single precision, 40 m from the origin


def test_the_same_with_all_threads() -> None:
    poses = random_poses(np.random.default_rng(0), 10_001)
    arguments = poses, (0.1, 0.5, -0.2), (0.05, 0.1, 0.05), stream_key(0, 1, 1)
    np.testing.assert_array_equal(moved(*arguments), moved(*arguments, work=10**9))


def test_headings_stay_within_a_turn() -> None:
    poses = random_poses(np.random.default_rng(4), 5000)
    for motion in [(1.5, 0.1, 3.1), (-1.5, 0.1, -3.1), (0.0, 0.0, math.pi)]:
        theta = moved(poses, motion, (0.1, 0.1, 0.1), stream_key(0, 0, 0))[:, 2]
        assert np.abs(theta).max() <= np.float32(math.pi)


@pytest.mark.parametrize("std", [2.0, 50.0, 1e6])
def test_headings_stay_within_a_turn_whatever_the_noise(std: float) -> None:
    """2 m between two updates are enough for the first with the course's alpha2, 1 rad^2/m^2."""
    poses = random_poses(np.random.default_rng(4), 50_000)
    theta = moved(poses, (0.0, 2.0, 0.0), (std, 0.2, std), stream_key(0, 0, 0))[:, 2]
    assert theta.min() >= -np.float32(math.pi)
    assert theta.max() < np.float32(math.pi)


def test_several_turns_of_noise_are_those_of_the_twin() -> None:
    poses = random_poses(np.random.default_rng(4), 300)
    arguments = (0.0, 2.0, 0.0), (4.0, 0.2, 4.0), stream_key(0, 0, 0)
    expected = reference.move(poses, *arguments[:2], int(arguments[2]), QUANTILES)
    assert difference(moved(poses, *arguments), expected) < 2e-5


def test_a_particle_moves_the_same_wherever_it_stands_in_the_array() -> None:
    poses = random_poses(np.random.default_rng(4), 100)
    arguments = (0.1, 0.5, 0.1), (0.1, 0.1, 0.1), stream_key(3, 0, 1)
    np.testing.assert_array_equal(moved(poses, *arguments)[:40], moved(poses[:40], *arguments))


# --- several ways to move --------------------------------------------------------------------------------------------


def by_gauss(mean, covariance) -> tuple[float, ...]:
    a, b, c = np.linalg.cholesky(covariance)
    return (0.0, 0.0, mean[0], a[0], 0.0, mean[1], b[0], b[1], mean[2], *c)


def moved_by(poses, ways, which, key, *, work: int = 0) -> np.ndarray:
    x, y, theta = np.ascontiguousarray(np.asarray(poses, np.float32).T)
    move(work, x, y, theta, np.array(ways, np.float32), np.asarray(which, np.int32), key, QUANTILES)
    return np.column_stack([x, y, theta])


def random_step(rng) -> tuple[np.ndarray, np.ndarray]:
    """A step and a covariance with every correlation."""
    mean = rng.uniform([-1, -0.3, -3], [2, 0.3, 3])
    axes = rng.normal(size=(3, 3)) * [[0.2], [0.1], [0.15]]
    return mean, axes @ axes.T + 1e-4 * np.eye(3)


def shared_out(*counts: int) -> np.ndarray:
    return np.repeat(np.arange(len(counts)), counts)


@given(st.integers(0, 2**32 - 1), st.integers(0, SHARES), st.integers(0, SHARES))
@settings(max_examples=40, deadline=None)
def test_several_ways_agree_with_the_twin(seed: int, a: int, b: int) -> None:
    rng = np.random.default_rng(seed)
    steps, poses, key = [random_step(rng) for _ in range(3)], random_poses(rng, 60), stream_key(seed, 1, 1)
    first, second = sorted((a, b))
    which = shared_out(first, second - first, SHARES - second)
    expected = reference.move_by(poses, steps, which, int(key), QUANTILES)
    assert difference(moved_by(poses, [by_gauss(*step) for step in steps], which, key), expected) < 2e-5


def test_several_ways_are_the_same_with_all_threads() -> None:
    rng = np.random.default_rng(1)
    ways = [by_gauss(*random_step(rng)), by_wheels((0.1, 0.5, -0.2), (0.05, 0.1, 0.05))]
    arguments = random_poses(rng, 10_001), ways, shared_out(200, 56), stream_key(0, 1, 1)
    np.testing.assert_array_equal(moved_by(*arguments), moved_by(*arguments, work=10**9))


def test_shares_and_statistics_of_each_way() -> None:
    """Which way a particle went is told by its heading: the ways turn to three sides."""
    rng, n, counts = np.random.default_rng(2), 200_000, (154, 77, 25)
    steps = [random_step(rng) for _ in counts]
    for (mean, _), turn in zip(steps, (-2.0, 0.0, 2.0), strict=True):
        mean[2] = turn
    start = np.array([3.0, 2.0, 0.7])
    moved = moved_by(
        np.tile(start, (n, 1)), [by_gauss(*step) for step in steps], shared_out(*counts), stream_key(9, 0, 1)
    )
    made = between(start, moved)
    went = np.argmin(np.abs(made[:, 2:] - [mean[2] for mean, _ in steps]), axis=1)
    for way, (mean, covariance) in enumerate(steps):
        share, followers = counts[way] / SHARES, made[went == way]
        m = len(followers)
        assert abs(m - n * share) < 5 * math.sqrt(n * share * (1 - share))
        std = np.sqrt(np.diag(covariance))
        # Five standard errors of a mean, of a deviation, and of a correlation.
        assert (np.abs(followers.mean(axis=0) - mean) < 5 * std / math.sqrt(m) + 1e-5).all()
        found = np.cov(followers.T)
        np.testing.assert_allclose(np.sqrt(np.diag(found)), std, rtol=5 / math.sqrt(2 * m))
        assert np.abs((found - covariance) / np.outer(std, std)).max() < 5 * math.sqrt(2 / m)


def test_a_way_is_followed_alike_whatever_the_others_are() -> None:
    """A particle that follows the wheels lands where it would if all did."""
    rng = np.random.default_rng(3)
    wheels, laser = by_wheels((0.1, 0.5, -0.2), (0.05, 0.1, 0.05)), by_gauss(*random_step(rng))
    poses, key = random_poses(rng, 3000), stream_key(4, 1, 1)
    alone, mixed = moved_by(poses, [wheels], shared_out(256), key), moved_by(poses, [laser, wheels], [0, 1] * 128, key)
    follows = np.array([reference.random_bits(int(key), i) >> 56 & 1 for i in range(3000)], bool)
    np.testing.assert_array_equal(alone[follows], mixed[follows])
    assert (alone[~follows] != mixed[~follows]).any(axis=1).all()


@given(st.integers(0, 2**32 - 1), st.integers(0, 300), st.integers(0, SHARES))
@settings(max_examples=40, deadline=None)
def test_who_followed_which_way_agrees_with_the_twin(seed: int, n: int, first: int) -> None:
    weights, which = np.random.default_rng(seed).random(n), shared_out(first, SHARES - first).astype(np.int32)
    out, key = np.full(2, np.nan), stream_key(seed, 1, 1)
    followed(weights, which, key, out)
    np.testing.assert_allclose(out, reference.followed(weights, which, int(key), 2), rtol=1e-12, atol=1e-12)
