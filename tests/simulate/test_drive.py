"""The robot does what it is told, within what its wheels can do."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import MclError
from pipeline.geometry import between
from pipeline.simulate.building import Robot
from pipeline.simulate.drive import STEP, drive


def robot(*legs: dict[str, Any], **more: Any) -> Robot:
    return Robot.model_validate({"start": [0, 0], "legs": legs, **more})


def test_it_gets_where_it_is_sent_and_stops_there() -> None:
    motion = drive(robot({"to": [3, 0]}, {"to": [3, 2]}))
    assert np.hypot(*(motion.poses[-1, :2] - [3, 2])) < 0.1
    assert motion.length == pytest.approx(5.0, abs=0.5)  # it cuts the corner
    assert np.hypot(*(motion.poses[-1] - motion.poses[-2])[:2]) / STEP < 0.3


def test_turning_and_pausing_happen_on_the_spot() -> None:
    motion = drive(robot({"turn_deg": -200}, {"pause": 2}, heading_deg=30))
    assert np.ptp(motion.poses[:, :2], axis=0).tolist() == [0.0, 0.0]
    assert motion.poses[-1, 2] == pytest.approx(math.radians(-170), abs=math.radians(0.5))
    still = motion.poses[motion.times > motion.times[-1] - 1.9, 2]
    assert np.ptp(still) == 0.0


def test_backwards_keeps_the_heading() -> None:
    motion = drive(robot({"to": [-2, 0], "backwards": True}))
    assert motion.poses[-1] == pytest.approx([-2, 0, 0], abs=0.1)
    assert (between(motion.poses[:-1], motion.poses[1:])[:, 0] <= 0.0).all()


@given(
    st.lists(st.tuples(st.floats(-8, 8), st.floats(-8, 8), st.booleans()), min_size=1, max_size=5),
    st.floats(0.2, 1.5),
    st.floats(0.3, 2.0),
    st.floats(30.0, 120.0),
)
def test_the_limits_hold(points, speed: float, acceleration: float, turn_rate: float) -> None:
    legs = [{"to": [x, y], "backwards": backwards} for x, y, backwards in points]
    motion = drive(robot(*legs, speed=speed, acceleration=acceleration, turn_rate_deg=turn_rate))
    steps = np.diff(motion.poses, axis=0)
    speeds = np.hypot(steps[:, 0], steps[:, 1]) / STEP
    assert speeds.max(initial=0.0) <= speed + 1e-9
    assert np.abs(np.diff(speeds)).max(initial=0.0) <= acceleration * STEP + 1e-6
    assert np.abs(steps[:, 2]).max(initial=0.0) <= math.radians(turn_rate) * STEP + 1e-9
    assert np.hypot(*(motion.poses[-1, :2] - points[-1][:2])) < 0.6


def test_poses_between_the_steps() -> None:
    motion = drive(robot({"to": [3, 0]}))
    middle = motion.at([motion.times[50], (motion.times[50] + motion.times[51]) / 2, -1.0, 1e6])
    assert middle[0] == pytest.approx(motion.poses[50])
    assert middle[1] == pytest.approx((motion.poses[50] + motion.poses[51]) / 2)
    assert middle[2:] == pytest.approx(motion.poses[[0, -1]])


def test_a_point_out_of_reach_is_an_error() -> None:
    with pytest.raises(MclError, match=r"legs\[0\]"):
        drive(robot({"to": [400, 0], "speed": 0.1}))
