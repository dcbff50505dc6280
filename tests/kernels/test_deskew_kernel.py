"""Carrying the ends of beams to one place, against the twin."""

from __future__ import annotations

import math

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.kernels import deskew as kernel

RULES = {"steepest": kernel.STEEPEST, "rough": kernel.ROUGH, "widest": kernel.WIDEST, "aside": kernel.ASIDE}
LIMITS = np.float32(0.05), np.float32(20.0)


def carried(ranges, first, step, motion, *, backward: bool = False, limits=LIMITS) -> np.ndarray:
    out = np.empty(len(ranges), np.float32)
    kernel.carry(np.asarray(ranges, np.float32), first, step, backward, *(float(v) for v in motion), *limits, out)
    return out


def expected(ranges, first, step, motion, *, backward: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """The twin's readings in the order of the beams, and where rounding may decide otherwise."""
    angles, order = first + step * np.arange(len(ranges)), slice(None, None, -1 if backward else 1)
    measured = np.asarray(ranges, np.float32).astype(float)[order]
    readings, doubt = reference.deskewed(measured, angles[order], motion, **RULES)
    low, high = LIMITS
    doubt[np.minimum(np.abs(readings - low), np.abs(readings - high)) < 1e-4] = 0.0
    readings[readings > high] = math.inf
    readings[readings < low] = math.nan
    return readings[order], doubt[order] < 1e-6


def scene(rng: np.random.Generator, beams: int) -> np.ndarray:
    """Stretches of walls near and far, of nothing, and of beams that were not measured."""
    ranges = np.empty(beams)
    at = 0
    while at < beams:
        length = int(rng.integers(1, 9))
        kind = rng.choice(["wall", "nothing", "invalid"], p=[0.8, 0.1, 0.1])
        wall = rng.uniform(0.3, 12.0) + rng.uniform(-0.1, 0.1) * np.arange(length)
        stretch = {"wall": np.maximum(wall, 0.1), "nothing": np.inf, "invalid": np.nan}[kind]
        ranges[at : at + length] = np.broadcast_to(stretch, length)[: beams - at]
        at += length
    return ranges


@given(
    st.integers(0, 2**32 - 1),
    st.integers(2, 60),
    st.floats(0.3, 2 * math.pi),
    st.tuples(st.floats(-0.25, 0.25), st.floats(-0.25, 0.25), st.floats(-0.6, 0.6)),
    st.booleans(),
)
@settings(max_examples=150, deadline=None)
def test_agrees_with_the_twin(seed: int, beams: int, field: float, motion, backward: bool) -> None:
    rng = np.random.default_rng(seed)
    arguments = scene(rng, beams), rng.uniform(-math.pi, 0.0), field / beams, motion
    readings, undecided = expected(*arguments, backward=backward)
    found = carried(*arguments, backward=backward)
    decided = ~undecided
    np.testing.assert_allclose(found[decided], readings[decided], rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("turn", [1e-8, 3.0, -3.0])
def test_hardly_turning_and_turning_almost_round(turn: float) -> None:
    arguments = scene(np.random.default_rng(1), 90), -math.pi, 2 * math.pi / 90, (0.1, 0.05, turn)
    readings, undecided = expected(*arguments)
    np.testing.assert_allclose(carried(*arguments)[~undecided], readings[~undecided], rtol=1e-4)
    assert undecided.mean() < 0.2  # where nothing came back, a beam that is hardly turned is where it was


def test_backward_is_the_mirror_image() -> None:
    ranges = scene(np.random.default_rng(2), 120)
    forward = carried(ranges, -1.0, 2.0 / 119, (0.1, 0.03, 0.2))
    mirrored = carried(ranges[::-1], -1.0, 2.0 / 119, (0.1, -0.03, -0.2), backward=True)
    np.testing.assert_allclose(mirrored[::-1], forward, rtol=1e-5)


def test_a_turn_to_one_side_leaves_a_gap_and_to_the_other_none() -> None:
    """A full turn of beams while the robot turns by ten of them."""
    step = 2 * math.pi / 360
    with_it = carried(np.full(360, 5.0), 0.0, step, (0.0, 0.0, 10 * step))
    np.testing.assert_allclose(with_it, 5.0, rtol=1e-3)
    against = carried(np.full(360, 5.0), 0.0, step, (0.0, 0.0, -10 * step))
    assert np.isnan(against[-9:]).all()
    assert np.isfinite(against[:-10]).all()


def test_what_was_not_measured_stays_unknown_and_nothing_stays_nothing() -> None:
    step = 0.01
    ranges = np.full(100, 4.0)
    ranges[20:30], ranges[60:70] = np.nan, np.inf
    found = carried(ranges, 0.0, step, (0.0, 0.0, 5 * step))
    assert np.isnan(found[22:30]).all()
    assert np.isinf(found[64:72]).all()
    assert np.isfinite(found[33:62]).all()


def test_the_nearer_hides_what_is_behind_it() -> None:
    """Driving sideways past a post: where it was measured it no longer is, and hides another part of the wall."""
    ranges = np.full(101, 8.0)
    ranges[50] = 0.6
    found = carried(ranges, -0.5, 0.01, (0.0, 0.2, 0.0))
    assert (found < 1.0).sum() in (1, 2)
    assert np.nanargmin(found) > 60


def test_beyond_the_longest_range_nothing_comes_back() -> None:
    found = carried(np.full(50, 9.99), -0.25, 0.01, (0.5, 0.0, 0.0), limits=(np.float32(9.9), np.float32(10.0)))
    assert np.isinf(found[30:-1]).all()
    found = carried(np.full(50, 9.99), -0.25, 0.01, (-0.5, 0.0, 0.0), limits=(np.float32(9.9), np.float32(10.0)))
    assert np.isnan(found[30:-1]).all()
