"""Moving particles: Table 5.6 with its noise, against the twin."""

from __future__ import annotations

import math

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.kernels.motion import move
from pipeline.kernels.random import normal_quantiles, stream_key

QUANTILES = normal_quantiles()


def moved(poses, motion, std, key, *, work: int = 0) -> np.ndarray:
    x, y, theta = np.ascontiguousarray(np.asarray(poses, np.float32).T)
    rot1, trans, rot2 = (float(v) for v in motion)
    move(work, x, y, theta, rot1, trans, rot2, *(float(s) for s in std), key, QUANTILES, QUANTILES)
    return np.column_stack([x, y, theta])


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
