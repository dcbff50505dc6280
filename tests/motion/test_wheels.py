"""The odometry motion model (Table 5.6): exact without noise, and with it as spread as the formula says."""

from __future__ import annotations

import math

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.config import Config
from pipeline.geometry import between, compose, wrap_angle
from pipeline.kernels.random import stream_key
from pipeline.motion.models import Component
from pipeline.motion.mover import Mover
from pipeline.motion.prior import Prior
from pipeline.motion.wheels import odometry_motion

ALPHAS = ("alpha1", "alpha2", "alpha3", "alpha4")


def with_alphas(*alphas: float) -> Config:
    return Config(**dict(zip(ALPHAS, alphas, strict=True)))


QUIET = with_alphas(0, 0, 0, 0)
coordinates = st.floats(-30, 30)
poses = st.tuples(coordinates, coordinates, st.floats(-3.14, 3.14))


def drawn(start, before, after, config: Config, n: int = 1, key: int = 5) -> np.ndarray:
    """Where n particles that stand at ``start`` go, (n, 3)."""
    m = odometry_motion(np.asarray(before, float), np.asarray(after, float), config)
    moved = np.repeat(np.asarray(start, np.float32)[:, None], n, axis=1)
    Mover().move(moved, Prior((Component("wheels", np.zeros(3), np.eye(3), table=m),)), stream_key(key, 1, 1))
    return moved.T.astype(float)


def assert_pose(found, expected, atol: float) -> None:
    np.testing.assert_allclose(found[:2], expected[:2], atol=atol)
    assert abs(wrap_angle(found[2] - expected[2])) < atol


@given(poses, poses, poses)
@settings(deadline=None)
def test_without_noise_a_particle_drives_as_the_odometry_says(start, before, after) -> None:
    expected = compose(start, between(before, after))
    assert_pose(drawn(start, before, after, QUIET)[0], expected, atol=2e-4)  # single precision, 100 m away


@pytest.mark.parametrize(
    "step",
    [
        (0.4, 0.0, 0.0),  # forwards
        (-0.4, 0.0, 0.0),  # backwards
        (0.0, 0.0, 1.2),  # on the spot
        (0.0, 0.0, -3.0),
        (0.003, -0.001, 0.3),  # on the spot, as far as wheels can tell
        (0.0, 0.5, 0.0),  # sideways
        (0.3, 0.2, 0.9),
        (-0.3, 0.2, -0.9),
        (0.0, 0.0, 0.0),
    ],
)
def test_without_noise_every_kind_of_step(step) -> None:
    before, start = np.array([5.0, -2.0, 2.9]), np.array([1.0, 2.0, -2.8])
    expected = compose(start, step)
    assert_pose(drawn(start, before, compose(before, step), QUIET)[0], expected, atol=2e-6)


def test_forwards_backwards_and_on_the_spot_are_told_apart() -> None:
    origin = np.zeros(3)
    forwards = odometry_motion(origin, np.array([0.4, 0.0, 0.1]), QUIET)
    assert (forwards.rot1, forwards.trans, forwards.rot2) == pytest.approx((0.0, 0.4, 0.1))
    backwards = odometry_motion(origin, np.array([-0.4, 0.0, 0.1]), QUIET)
    assert (backwards.rot1, backwards.trans, backwards.rot2) == pytest.approx((0.0, -0.4, 0.1))
    still = odometry_motion(origin, origin, Config())
    assert (still.trans, still.std_rot1, still.std_trans, still.std_rot2) == (0, 0, 0, 0)


@given(st.floats(0.02, 2.0), st.floats(-1.5, 1.5), st.floats(-3.0, 3.0))
@settings(deadline=None)
def test_deviations_are_those_of_the_formula(trans: float, rot1: float, turn: float) -> None:
    alphas = 0.03, 0.2, 0.05, 0.007
    after = np.array([trans * math.cos(rot1), trans * math.sin(rot1), turn])
    m = odometry_motion(np.zeros(3), after, with_alphas(*alphas))
    rot2 = float(wrap_angle(turn - rot1))
    assert (m.rot1, m.trans, m.rot2) == pytest.approx((rot1, trans, rot2), abs=1e-9)
    expected = reference.deviations(rot1, trans, rot2, alphas)
    assert (m.std_rot1, m.std_trans, m.std_rot2) == pytest.approx(expected, abs=1e-12)


@given(st.floats(0.02, 2.0), st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))
@settings(deadline=None)
def test_a_backward_drive_is_as_noisy_as_the_forward_one(trans: float, rot1: float, rot2: float) -> None:
    config = with_alphas(0.03, 0.2, 0.05, 0.007)
    there = np.array([trans * math.cos(rot1), trans * math.sin(rot1), rot1 + rot2])
    forwards = odometry_motion(np.zeros(3), there, config)
    # The same turns with the gear in reverse, and the same path driven home again.
    reverse = odometry_motion(np.zeros(3), there * [-1, -1, 1], config)
    home = odometry_motion(there, np.zeros(3), config)
    assert reverse.trans == pytest.approx(-forwards.trans)
    assert home.trans == pytest.approx(-forwards.trans)
    deviations = forwards.std_rot1, forwards.std_trans, forwards.std_rot2
    assert (reverse.std_rot1, reverse.std_trans, reverse.std_rot2) == pytest.approx(deviations)
    assert (home.std_rot2, home.std_trans, home.std_rot1) == pytest.approx(deviations)


def components(start, moved) -> np.ndarray:
    """The three draws of every particle, recovered from where it went: (3, n), for drives forwards."""
    dx, dy = moved[:, 0] - start[0], moved[:, 1] - start[1]
    rot1 = wrap_angle(np.arctan2(dy, dx) - start[2])
    return np.stack([rot1, np.hypot(dx, dy), wrap_angle(moved[:, 2] - start[2] - rot1)])


def test_statistics_of_many_draws() -> None:
    n, alphas = 100_000, (0.01, 0.004, 0.002, 0.005)
    motion = rot1, trans, rot2 = 0.4, 1.5, -0.7
    after = (trans * math.cos(rot1), trans * math.sin(rot1), rot1 + rot2)
    start = np.array([2.0, 1.0, 0.3])
    draws = components(start, drawn(start, np.zeros(3), after, with_alphas(*alphas), n))
    std = np.array(reference.deviations(rot1, trans, rot2, alphas))
    # Five standard errors of a mean and of a deviation.
    assert (np.abs(draws.mean(axis=1) - motion) < 5 * std / math.sqrt(n)).all()
    np.testing.assert_allclose(draws.std(axis=1), std, rtol=5 / math.sqrt(2 * n))
    correlation = np.corrcoef(draws) - np.eye(3)
    assert np.abs(correlation).max() < 5 / math.sqrt(n)


def test_statistics_of_turning_on_the_spot() -> None:
    n, alphas = 100_000, (0.01, 0.3, 0.2, 0.004)
    start = np.array([2.0, 1.0, -0.5])
    moved = drawn(start, np.zeros(3), (0.0, 0.0, 0.8), with_alphas(*alphas), n)
    turned = wrap_angle(moved[:, 2] - start[2])
    # All of it is one turn of 0.8 rad; nothing was driven, so alpha2 and alpha3 have nothing to say.
    assert turned.mean() == pytest.approx(0.8, abs=5 * 0.08 / math.sqrt(n))
    assert turned.std() == pytest.approx(math.sqrt(0.01) * 0.8, rel=5 / math.sqrt(2 * n))
    off = np.hypot(moved[:, 0] - start[0], moved[:, 1] - start[1])
    assert math.sqrt(np.mean(off**2)) == pytest.approx(math.sqrt(0.004) * 0.8, rel=0.02)


@pytest.mark.parametrize(("alpha", "expected"), [(0, (1, 0, 1)), (1, (1, 0, 1)), (2, (0, 1, 0)), (3, (0, 1, 0))])
def test_each_alpha_alone(alpha: int, expected) -> None:
    """alpha1: rotation by rotation; alpha2: rotation by driving; alpha3: driving by driving; alpha4: by rotation."""
    values = [0.0] * 4
    values[alpha] = 0.01
    rot1, trans, rot2 = 0.4, 1.5, -0.7
    after = (trans * math.cos(rot1), trans * math.sin(rot1), rot1 + rot2)
    draws = components(np.zeros(3), drawn(np.zeros(3), np.zeros(3), after, with_alphas(*values), 20_000))
    std = np.array(reference.deviations(rot1, trans, rot2, values))
    assert tuple((std > 0).astype(int)) == expected
    np.testing.assert_allclose(draws.std(axis=1), std, rtol=0.03, atol=1e-5)


def test_noise_grows_with_the_root_of_alpha() -> None:
    before, after = np.zeros(3), np.array([0.5, 0.1, 0.4])
    one = odometry_motion(before, after, with_alphas(0.01, 0.02, 0.03, 0.04))
    four = odometry_motion(before, after, with_alphas(0.04, 0.08, 0.12, 0.16))
    assert four.std_rot1 == pytest.approx(2 * one.std_rot1)
    assert four.std_trans == pytest.approx(2 * one.std_trans)
    assert four.std_rot2 == pytest.approx(2 * one.std_rot2)


def test_the_frame_of_the_odometry_does_not_matter() -> None:
    step = np.array([0.3, -0.05, 0.2])
    config = Config()
    here = odometry_motion(np.zeros(3), step, config)
    for frame in ([100.0, -50.0, 3.0], [-3.0, 2.0, -3.1]):
        there = odometry_motion(np.array(frame), compose(frame, step), config)
        assert vars(there) == pytest.approx(vars(here), abs=1e-9)
