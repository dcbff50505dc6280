"""Poses in the plane: a group, with angles in [-pi, pi)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.geometry import between, compose, inverse, quaternion_to_yaw, wrap_angle, yaw_to_quaternion

coordinates = st.floats(-1000, 1000)
angles = st.floats(-math.pi, math.pi, exclude_max=True)
poses = st.tuples(coordinates, coordinates, angles)


def assert_same(a, b) -> None:
    np.testing.assert_allclose(a[..., :2], np.asarray(b)[..., :2], atol=1e-9)
    np.testing.assert_allclose(np.exp(1j * a[..., 2]), np.exp(1j * np.asarray(b)[..., 2]), atol=1e-9)


def matrix(pose) -> np.ndarray:
    x, y, yaw = pose
    return np.array([[math.cos(yaw), -math.sin(yaw), x], [math.sin(yaw), math.cos(yaw), y], [0, 0, 1]])


@given(st.floats(-1e4, 1e4))
def test_wrap_angle(angle: float) -> None:
    wrapped = float(wrap_angle(angle))
    assert -math.pi <= wrapped < math.pi
    turns = (angle - wrapped) / (2 * math.pi)
    assert turns == pytest.approx(round(turns), abs=1e-9)


def test_wrap_angle_at_the_seam() -> None:
    assert float(wrap_angle(math.pi)) == -math.pi
    assert float(wrap_angle(-math.pi)) == -math.pi
    np.testing.assert_allclose(wrap_angle([3 * math.pi / 2, -3 * math.pi / 2, 0.0]), [-math.pi / 2, math.pi / 2, 0.0])


@given(poses, poses)
def test_compose_is_the_product_of_matrices(a, b) -> None:
    np.testing.assert_allclose(matrix(compose(a, b)), matrix(a) @ matrix(b), atol=1e-9)


@given(poses, poses, poses)
def test_compose_is_associative(a, b, c) -> None:
    assert_same(compose(compose(a, b), c), compose(a, compose(b, c)))


@given(poses)
def test_inverse(a) -> None:
    assert_same(compose(a, inverse(a)), np.zeros(3))
    assert_same(compose(inverse(a), a), np.zeros(3))


@given(poses, poses)
def test_between(a, b) -> None:
    assert_same(compose(a, between(a, b)), b)


def test_known_pose() -> None:
    """Two metres ahead of a robot that looks north, and a quarter turn to the left."""
    np.testing.assert_allclose(compose([1.0, 2.0, math.pi / 2], [2.0, 0.5, math.pi / 2]), [0.5, 4.0, -math.pi])


def test_broadcasting() -> None:
    many = np.random.default_rng(0).normal(size=(4, 5, 3))
    one = np.array([1.0, -2.0, 0.3])
    assert compose(one, many).shape == compose(many, one).shape == (4, 5, 3)
    np.testing.assert_allclose(compose(one, many)[2, 3], compose(one, many[2, 3]))
    np.testing.assert_allclose(between(many, one)[2, 3], between(many[2, 3], one))


@given(angles)
def test_quaternions(yaw: float) -> None:
    q = yaw_to_quaternion(yaw)
    assert math.hypot(*q) == pytest.approx(1.0)
    back = float(quaternion_to_yaw(*q))
    assert math.cos(back - yaw) == pytest.approx(1.0)
    # The opposite quaternion is the same turn.
    assert math.cos(float(quaternion_to_yaw(*(-c for c in q))) - yaw) == pytest.approx(1.0)


def test_quaternion_of_a_tilted_robot_gives_the_heading_of_its_x_axis() -> None:
    yaw, pitch = 0.7, 0.2
    cy, sy, cp, sp = math.cos(yaw / 2), math.sin(yaw / 2), math.cos(pitch / 2), math.sin(pitch / 2)
    assert float(quaternion_to_yaw(-sy * sp, cy * sp, sy * cp, cy * cp)) == pytest.approx(yaw)
