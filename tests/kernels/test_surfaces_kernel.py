"""Points on walls with their normals, against the twin that fits every line by an eigenvalue problem."""

from __future__ import annotations

import math

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.kernels.surfaces import SIDE, surfaces

WINDOW, THICKNESS, SPACING, LONGEST = 0.2, 0.03, 0.05, 12.0


def found(ranges, angles, *, at=(0.0, 0.0), longest=LONGEST, thickness=THICKNESS, spacing=SPACING) -> np.ndarray:
    out = np.empty((4, len(ranges)), np.float32)
    step = abs(float(angles[1] - angles[0]))
    limits = longest, step, WINDOW, thickness, spacing
    n = surfaces(np.asarray(ranges, np.float32), np.cos(angles), np.sin(angles), *at, *limits, out)
    return out[:, :n]


def in_a_room(angles, at, yaw, half=(3.0, 2.0)) -> np.ndarray:
    """Exact ranges from a place in a rectangle about the origin."""
    c, s = np.cos(angles + yaw), np.sin(angles + yaw)
    with np.errstate(divide="ignore"):
        x = np.where(c > 0, half[0] - at[0], -half[0] - at[0]) / c
        y = np.where(s > 0, half[1] - at[1], -half[1] - at[1]) / s
    return np.minimum(x, y)


@given(st.integers(0, 2**32 - 1), st.integers(20, 400), st.floats(0.5, 6.28))
@settings(max_examples=60, deadline=None)
def test_agrees_with_the_twin(seed: int, beams: int, view: float) -> None:
    rng = np.random.default_rng(seed)
    angles = np.linspace(-view / 2, view / 2, beams)
    ranges = in_a_room(angles, rng.uniform([-2, -1], [2, 1]), rng.uniform(-3, 3))
    ranges = ranges + rng.normal(0.0, rng.choice([0.0, 0.01, 0.03]), beams)
    near = rng.random(beams) < 0.2
    ranges[near] *= rng.uniform(0.3, 1.0)
    ranges[rng.random(beams) < 0.1] = rng.choice([np.nan, np.inf, -np.inf, 0.0, -1.0, 50.0])
    ranges = ranges.astype(np.float32)
    at = rng.uniform(-0.3, 0.3, 2)
    expected, undecided = reference.surfaces(
        ranges, angles, at, longest=LONGEST, window=WINDOW, thickness=THICKNESS, spacing=SPACING, side=SIDE
    )
    if undecided:
        return
    points = found(ranges, angles, at=at)
    assert points.shape == expected.shape
    np.testing.assert_allclose(points, expected, atol=2e-5)


def test_points_of_a_wall_lie_on_it_and_face_the_laser() -> None:
    angles = np.deg2rad(np.arange(-180, 180))
    at, yaw = np.array([0.7, -0.4]), 0.3
    points = found(in_a_room(angles, at, yaw), angles)
    c, s = math.cos(yaw), math.sin(yaw)
    x, y = at[0] + c * points[0] - s * points[1], at[1] + s * points[0] + c * points[1]
    nx, ny = c * points[2] - s * points[3], s * points[2] + c * points[3]
    corner = (np.abs(x) > 2.75) & (np.abs(y) > 1.75)
    off = np.minimum(np.abs(3.0 - np.abs(x)), np.abs(2.0 - np.abs(y)))[~corner]
    assert off.max() < 1e-5
    facing = np.where(np.abs(x) > 2.999, -np.sign(x) * nx, -np.sign(y) * ny)[~corner]
    assert facing.min() > 1 - 1e-5
    np.testing.assert_allclose(np.hypot(nx, ny), 1.0, atol=1e-6)
    assert np.hypot(*np.diff(points[:2])).min() > SPACING - 0.02


def test_whatever_is_no_wall_gives_no_points() -> None:
    angles = np.deg2rad(np.arange(-90, 90))
    for reading in (np.nan, np.inf, -np.inf, 0.0, -2.0, LONGEST + 0.1):
        assert found(np.full(180, reading), angles).shape == (4, 0)
    alone = np.where(np.arange(180) % 4 == 0, 3.0, np.nan)
    assert found(alone, angles).shape == (4, 0), "a single reading says nothing of the wall's direction"


@pytest.mark.parametrize("rough", [0.0, 0.01])
def test_beams_in_reverse_see_the_same_walls(rough: float) -> None:
    """Points are chosen from the other end, so they are other ones; they lie on the same walls."""
    angles = np.deg2rad(np.arange(-90, 90))
    ranges = in_a_room(angles, (0.5, 0.5), 0.2) + np.random.default_rng(1).normal(0.0, rough, 180)
    one, other = found(ranges, angles), found(ranges[::-1], angles[::-1])
    assert abs(one.shape[1] - other.shape[1]) < 8
    gaps = np.hypot(one[0][:, None] - other[0], one[1][:, None] - other[1])
    assert gaps.min(axis=1).max() < 0.15
    facing = one[2] * other[2, gaps.argmin(axis=1)] + one[3] * other[3, gaps.argmin(axis=1)]
    assert np.quantile(facing, 0.1) > 0.99
