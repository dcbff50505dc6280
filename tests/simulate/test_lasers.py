"""Lasers of any kind against rays in a rectangle, solved by hand; and what is measured while the robot moves."""

from __future__ import annotations

import math
from typing import Any

import buildings
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.geometry import between, compose, wrap_angle
from pipeline.logs.messages import Log
from pipeline.simulate import Building, Simulated, simulate_log
from pipeline.simulate.building import Laser
from pipeline.simulate.drive import interpolate
from pipeline.simulate.rays import nearest_segments, segment_hits
from pipeline.simulate.world import people_at

INSIDE = (1.06, 1.06, 8.94, 6.94)  # the faces of the room's walls


def empty(make: Any, **laser: Any) -> Building:
    return make(furniture=[], laser=buildings.silent | {"rate": 4} | laser, odometry=buildings.exact)


def to_the_wall(x: np.ndarray, y: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """From inside a rectangle to its border."""
    x0, y0, x1, y1 = INSIDE
    cos, sin = np.cos(angle), np.sin(angle)
    with np.errstate(divide="ignore"):
        across = np.abs(np.where(cos > 0, x1 - x, x0 - x) / cos)
        return np.minimum(across, np.abs(np.where(sin > 0, y1 - y, y0 - y) / sin))


def measured_at(log: Log) -> np.ndarray:
    """When each beam of each scan was measured, by what the log says: (scans, beams) s."""
    order = np.arange(log.laser.beams)
    if log.laser.time_increment < 0:
        order = order[::-1]
    return log.stamps[:, None] / 1e9 + abs(log.laser.time_increment) * order


def expected(made: Simulated) -> np.ndarray:
    """Ranges (scans, beams) of the empty room from where the robot was at each beam."""
    log = made.log
    times = measured_at(log)
    robot = made.motion.at(times.ravel()).reshape(*times.shape, 3)
    place = compose(robot, log.laser.pose)
    return to_the_wall(place[..., 0], place[..., 1], place[..., 2] + log.laser.angles)


def test_the_usual_laser_is_that_of_the_raw_format() -> None:
    laser = Laser()
    assert laser.bearings.tolist() == np.deg2rad(np.arange(180) - 90.0).tolist()
    assert laser.mount == (0.25, 0.0, 0.0)
    assert laser.duration == 0.0


@pytest.mark.parametrize(
    ("beams", "view", "first", "step"),
    [(181, 180, -90, 1), (541, 270, -135, 0.5), (360, 360, -180, 1), (1440, 360, -180, 0.25), (60, None, -90, 3)],
)
def test_beams_fill_the_field_of_view(beams: int, view: float | None, first: float, step: float) -> None:
    laser = Laser(beams=beams, field_of_view_deg=view)
    assert np.degrees(laser.bearings) == pytest.approx(first + step * np.arange(beams), abs=1e-9)
    assert np.degrees([laser.angle_min, laser.angle_increment]) == pytest.approx([first, step])


@pytest.mark.parametrize("make", [buildings.room, buildings.turned_laser, buildings.upside_down])
@pytest.mark.parametrize("time_increment", [0.0, 0.0006])
def test_every_beam_is_measured_from_where_the_robot_was_then(make: Any, time_increment: float) -> None:
    made = simulate_log(empty(make, time_increment=time_increment), seed=1)
    assert made.log.ranges == pytest.approx(expected(made), abs=2e-6)
    assert made.log.laser.angle_increment > 0.0


def test_a_scan_of_a_moving_robot_is_bent() -> None:
    """What the stamp alone would make of it is off by decimetres, or the test above would show nothing."""
    made = simulate_log(empty(buildings.room, beams=360, field_of_view_deg=360, time_increment=0.0006), seed=1)
    place = compose(made.ground_truth.poses[:, None], made.log.laser.pose)
    rigid = to_the_wall(place[..., 0], place[..., 1], place[..., 2] + made.log.laser.angles)
    assert np.abs(made.log.ranges - rigid).max() > 0.1


def test_the_stamp_is_that_of_the_first_beam_measured() -> None:
    made = simulate_log(empty(buildings.upside_down), seed=1)
    assert made.log.laser.time_increment == -0.0002
    assert made.log.ranges[:, ::-1] == pytest.approx(made.ranges, abs=1e-6)
    place = compose(made.ground_truth.poses, made.log.laser.pose)
    first = to_the_wall(place[:, 0], place[:, 1], place[:, 2] + made.log.laser.angles[-1])
    assert made.ranges[:, 0] == pytest.approx(first, abs=1e-9)


def test_beams_meet_people_where_they_are_then() -> None:
    person = {"path": [[6, 2], [6, 6]], "speed": 2.0, "radius": 0.3}
    laser = buildings.silent | {"beams": 360, "field_of_view_deg": 360, "time_increment": 0.0005}
    robot = {"start": [3, 4], "legs": [{"pause": 4}]}
    made = simulate_log(buildings.room(furniture=[], people=[person], robot=robot, laser=laser), seed=1)
    times = measured_at(made.log)
    place = compose(made.motion.at(0.0), made.log.laser.pose)
    angles = place[2] + made.log.laser.angles
    ends = place[:2] + made.log.ranges[..., None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    short = made.log.ranges < to_the_wall(place[0], place[1], angles) - 1e-3
    away = np.hypot(*(ends - people_at(made.building.people, times)[..., 0, :2])[short].T)
    assert short.sum() > 100
    assert away == pytest.approx(np.full(short.sum(), 0.3), abs=1e-5)
    when_stamped = people_at(made.building.people, made.log.stamps / 1e9)[:, None, 0, :2]
    assert np.abs(np.hypot(*(ends - when_stamped)[short].T) - 0.3).max() > 0.1


def test_sweeps_tell_how_far_the_odometry_went_meanwhile() -> None:
    made = simulate_log(buildings.spinning(odometry=buildings.exact, laser={"rate": 5}), seed=2)
    assert made.log.sweeps is not None
    times = measured_at(made.log)
    true = between(made.motion.at(times[:, 0]), made.motion.at(times[:, -1]))
    assert made.log.sweeps == pytest.approx(true, abs=0.01)  # odometry is read 15 times a second
    read = made.odometry_stamps / 1e9
    assert read[-1] >= times.max()
    last = interpolate(times[:, -1], read, made.odometry)
    assert made.log.sweeps == pytest.approx(between(made.scan_odometry, last), abs=1e-9)
    assert simulate_log(buildings.room(), seed=2).log.sweeps is None


def test_a_gyroscope_tells_the_true_turn_within_its_noise() -> None:
    robot = buildings.turning().robot.model_dump(exclude_none=True) | {"start": [5, 4]}
    silent, noisy, biased = (
        simulate_log(buildings.room(robot=robot, imu={"rate": 100, "noise": noise, "bias": bias}), seed=3)
        for noise, bias in ((0.0, 0.0), (0.02, 0.0), (0.0, 0.05))
    )
    log = silent.log
    assert log.turns is not None
    assert noisy.log.turns is not None
    assert biased.log.turns is not None
    true = silent.motion.at(log.stamps / 1e9)[:, 2]
    turned = log.turns - log.turns[0]
    assert turned == pytest.approx(true - true[0], abs=math.radians(0.2))
    assert np.ptp(true) > 2 * np.pi
    error = noisy.log.turns - noisy.log.turns[0] - turned
    deviation = 0.02 * np.sqrt(log.times[-1] / 100)  # of a sum of readings that err on their own
    assert 0.0 < abs(error[-1]) < 4 * deviation
    assert biased.log.turns - log.turns == pytest.approx(0.05 * (log.stamps / 1e9), abs=1e-6)
    assert silent.gyroscope is not None
    assert len(silent.gyroscope.stamps) == pytest.approx(100 * log.times[-1], rel=0.03)
    assert simulate_log(buildings.room(), seed=3).log.turns is None


def test_other_sensors_leave_the_random_numbers_of_the_rest_alone() -> None:
    plain = simulate_log(buildings.room(), seed=5)
    more = simulate_log(buildings.room(imu={}, laser={"invalid": 0.2}), seed=5)
    kept = np.isfinite(more.ranges)
    assert more.ranges[kept].tolist() == plain.ranges[kept].tolist()
    assert more.odometry.tolist() == plain.odometry.tolist()
    assert np.array_equal(more.grid.occupancy, plain.grid.occupancy, equal_nan=True)


def test_readings_are_missing_or_invalid_as_often_as_they_should_be() -> None:
    ranges = simulate_log(buildings.dropouts(), seed=0).log.ranges
    assert np.isnan(ranges).mean() == pytest.approx(0.1, abs=0.01)
    assert np.isinf(ranges).mean() == pytest.approx(0.1 * 0.9, abs=0.01)


def test_the_log_in_memory_is_whole() -> None:
    made = simulate_log(buildings.room(), seed=0)
    log = made.log
    assert log.ranges.dtype == np.float32
    assert log.ranges.shape == (len(log), log.laser.beams)
    assert (np.diff(log.stamps) > 0).all()
    assert log.ground_truth is made.ground_truth
    assert made.ground_truth.stamps.tolist() == log.stamps.tolist()
    assert log.odometry == pytest.approx(
        np.column_stack([made.scan_odometry[:, :2], wrap_angle(made.scan_odometry[:, 2])])
    )
    assert log.grid is not None
    assert log.grid.resolution == 0.05
    assert log.sha256 != simulate_log(buildings.room(), seed=1).log.sha256
    assert sum(1 for _ in log.scans()) == len(log)


coordinate = st.floats(-5, 5)


@given(
    st.tuples(coordinate, coordinate),
    st.lists(st.tuples(coordinate, coordinate, coordinate, coordinate), max_size=5),
    st.floats(-10, 10),
    st.floats(-6.5, 6.5),
    st.floats(0, 2),
)
def test_the_nearest_segment_is_the_least_of_all_hits(origin, segments, first, span, moved) -> None:
    """Also for beams that turn to either side, more than once around, from places along a way."""
    angles = first + np.linspace(0, span, 50)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    way = np.array(origin) + moved * np.linspace(0, 1, 50)[:, None] * [0.6, -0.8]
    edges = np.array(segments, dtype=np.float64).reshape(-1, 4)
    for places in (np.array(origin), way):
        every = segment_hits(places, directions, edges).min(axis=1, initial=np.inf)
        assert nearest_segments(places, angles, edges).tolist() == every.tolist()
