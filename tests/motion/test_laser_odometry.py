"""Laser odometry in made-up buildings, whose truth is known: what makes that of others fail must not make ours."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from typing import Any

import buildings
import numpy as np
import pytest

from pipeline.config import Config
from pipeline.geometry import between, compose, wrap_angle
from pipeline.logs.messages import Log
from pipeline.motion.laser_odometry import Match
from pipeline.motion.models import Component, motion_model
from pipeline.motion.prior import AGREE, Prior, motion_prior
from pipeline.motion.witnesses import Motion, Witnesses
from pipeline.simulate import Building, Simulated, simulate_log

EVERYONE = pytest.mark.parametrize("odometry", ["both", "laser"])
NEAR_D, NEAR_A = 0.05, math.radians(2.0)
"""m, rad: so near the truth is every step that the laser tells."""


def heard(log: Log, odometry: str = "both") -> list[Motion]:
    """What the witnesses say of every scan."""
    witnesses = Witnesses(log.laser, Config(odometry=odometry), log.wheels)
    return [witnesses.update(scan) for scan in log.scans()]


def priors(motions: Sequence[Motion], odometry: str = "both") -> list[Prior]:
    config = Config(odometry=odometry)
    return [motion_prior(before, now, config, motion_model(config)) for before, now in itertools.pairwise(motions)]


def first_of(prior: Prior, name: str) -> Component:
    return next(component for component in prior.components if component.name == name)


def steps(poses: np.ndarray) -> np.ndarray:
    return between(poses[:-1], poses[1:])


def laser_poses(motions: Sequence[Motion]) -> np.ndarray:
    return np.array([motion.laser_pose for motion in motions])


def wheel_poses(motions: Sequence[Motion]) -> np.ndarray:
    return np.array([motion.odometry for motion in motions])


def errors(drive: Simulated, poses: np.ndarray) -> np.ndarray:
    """Of every step (n - 1, 3), in the frame of where it truly led."""
    return between(steps(drive.ground_truth.poses), steps(poses))


def assert_near(off: np.ndarray, distance: float = NEAR_D, angle: float = NEAR_A) -> None:
    assert np.hypot(off[:, 0], off[:, 1]).max() < distance
    assert np.abs(off[:, 2]).max() < angle


def assert_followed(drive: Simulated, motions: Sequence[Motion], distance: float = 0.05, angle: float = 0.02) -> None:
    """Every step is right, no match breaks, and little has added up at the end."""
    poses, truth = laser_poses(motions), drive.ground_truth.poses
    assert_near(errors(drive, poses))
    assert {motion.laser.stretch for motion in motions} == {motions[0].laser.stretch}
    end = between(between(truth[0], truth[-1]), between(poses[0], poses[-1]))
    assert math.hypot(end[0], end[1]) < distance
    assert abs(end[2]) < angle


def with_ranges(drive: Simulated, ranges: np.ndarray) -> Log:
    return dataclasses.replace(drive.log, ranges=ranges.astype(np.float32))


# --- every kind of drive ---------------------------------------------------------------------------------------------


@EVERYONE
@pytest.mark.parametrize(
    "building",
    [buildings.room, buildings.office, buildings.hard_braking, buildings.turning, buildings.dropouts],
    ids=lambda building: building.__name__,
)
def test_a_drive_is_followed(building: Any, odometry: str) -> None:
    """Round a room, among people, braking from 2 m/s, turning on the spot at 120 degrees a second, with dropouts."""
    for seed in range(2):
        drive = simulate_log(building(), seed)
        assert_followed(drive, heard(drive.log, odometry))


@pytest.mark.parametrize("upside_down", [False, True], ids=["upright", "upside down"])
@pytest.mark.parametrize("yaw", [90, -90, 180, 20])
def test_however_the_laser_is_mounted(yaw: float, upside_down: bool) -> None:
    """The true motion, not a mirrored one, nor one of the laser instead of the robot."""
    laser = {"pose": (0.2, -0.05, yaw), "upside_down": upside_down, "beams": 271, "field_of_view_deg": 270}
    drive = simulate_log(buildings.room(laser=laser), 3)
    assert_followed(drive, heard(drive.log, "laser"))


def test_hard_braking_is_seen_within_one_scan() -> None:
    """No word of the laser lags: what is left of the speed at each scan is what the robot has left."""
    drive = simulate_log(buildings.hard_braking(laser={"rate": 10}), 1)
    found = steps(laser_poses(heard(drive.log, "laser")))[:, 0]
    true = steps(drive.ground_truth.poses)[:, 0]
    braking = np.abs(np.diff(true)) > 0.05
    assert braking.sum() > 10
    np.testing.assert_allclose(np.diff(found)[braking], np.diff(true)[braking], atol=0.03)


@pytest.mark.parametrize("seed", range(4))
def test_standing_among_people_does_not_drift(seed: int) -> None:
    drive = simulate_log(buildings.standing(), seed)
    poses = laser_poses(heard(drive.log, "laser"))
    drift = poses[-10:].mean(axis=0) - poses[:10].mean(axis=0)
    assert math.hypot(drift[0], drift[1]) < 0.01
    assert abs(drift[2]) < 0.003
    assert np.hypot(*poses[:, :2].T).max() < 0.02


# --- every kind of laser ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("beams", [60, 180, 360, 720, 1440])
@pytest.mark.parametrize("view", [180, 270, 360])
def test_few_beams_and_many(beams: int, view: float) -> None:
    drive = simulate_log(buildings.room(laser={"beams": beams, "field_of_view_deg": view}), 5)
    assert_followed(drive, heard(drive.log, "laser"))


@pytest.mark.parametrize("beams", [60, 180, 720, 1440])
def test_a_quarter_of_a_turn_is_a_view(beams: int) -> None:
    """What is seen is at times a single wall, so that wheels have to help: more adds up until the end."""
    drive = simulate_log(buildings.room(laser={"beams": beams, "field_of_view_deg": 90}), 5)
    assert_followed(drive, heard(drive.log), distance=0.15)


@pytest.mark.parametrize(
    ("rate", "odometry"), [*((rate, "both") for rate in (0.3, 1, 2, 10, 40)), *((r, "laser") for r in (2, 10, 40))]
)
def test_few_scans_a_second_and_many(rate: float, odometry: str) -> None:
    """Down to one in three seconds, in which the robot has driven 2 m or turned by 180 degrees."""
    laser = {"beams": 360, "field_of_view_deg": 270, "rate": rate}
    drive = simulate_log(buildings.room(laser=laser), 5)
    assert_followed(drive, heard(drive.log, odometry))


# --- readings that are no ranges -------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.1, 0.3])
@pytest.mark.parametrize("reading", [math.nan, math.inf, -math.inf, 0.0])
def test_readings_that_say_nothing_cost_precision_only(reading: float, share: float) -> None:
    drive = simulate_log(buildings.room(), 4)
    lost = np.random.default_rng(0).random(drive.log.ranges.shape) < share
    assert_followed(drive, heard(with_ranges(drive, np.where(lost, reading, drive.log.ranges)), "laser"))


@EVERYONE
@pytest.mark.parametrize("reading", [math.nan, math.inf])
@pytest.mark.parametrize("dead", [slice(40, 41), slice(40, 46), slice(0, 3)], ids=["one", "several", "the first"])
def test_scans_without_a_reading_are_survived(dead: slice, reading: float, odometry: str) -> None:
    """They count as a break: nothing is claimed to be known across it, and the laser is believed again after it."""
    drive = simulate_log(buildings.room(), 4)
    ranges = drive.log.ranges.copy()
    ranges[dead] = reading
    motions = heard(with_ranges(drive, ranges), odometry)
    assert np.isfinite([motion.pose for motion in motions]).all()
    assert np.isfinite([motion.laser.covariance for motion in motions]).all()
    stretches = np.array([motion.laser.stretch for motion in motions])
    assert (np.diff(stretches[dead.start : dead.stop + 1]) > 0).all()
    assert len(set(stretches[dead.stop :])) == 1
    said = [prior.components[0].name for prior in priors(motions, odometry)]
    across = slice(max(dead.start - 1, 0), dead.stop)
    assert set(said[across]) == {"wheels" if odometry == "both" else "unseen"}
    assert set(said[: across.start] + said[across.stop :]) == {"laser"}
    assert_near(errors(drive, laser_poses(motions))[dead.stop :])
    if odometry == "both":
        assert_near(errors(drive, laser_poses(motions)))  # the wheels lead across it


# --- a hallway without an end ----------------------------------------------------------------------------------------


def test_along_a_hallway_the_wheels_say_how_far() -> None:
    """No word of 'no motion': the matches are open along it, and know nothing of how far."""
    drive = simulate_log(buildings.hallway(), 1)
    motions = heard(drive.log)
    poses = laser_poses(motions)
    for motion in motions[1:]:
        assert motion.laser.open is not None
        assert abs(motion.laser.open[0]) > 0.999  # it starts along x
        assert motion.laser.covariance[0, 0] > 100.0
        assert motion.laser.fit > 0.6
    np.testing.assert_allclose(steps(poses)[:, 0], steps(wheel_poses(motions))[:, 0], atol=0.005)
    assert_near(errors(drive, poses))
    end = between(between(drive.ground_truth.poses[0], drive.ground_truth.poses[-1]), poses[-1])
    assert abs(end[1]) < 0.05, "across it the walls say where"
    assert abs(end[2]) < 0.01


def test_along_a_hallway_the_prior_is_as_sure_as_the_wheels_and_across_it_as_the_laser() -> None:
    drive = simulate_log(buildings.hallway(), 1)
    for prior in priors(heard(drive.log)):
        laser, wheels = first_of(prior, "laser"), first_of(prior, "wheels")
        assert laser.covariance[0, 0] == pytest.approx(wheels.covariance[0, 0], rel=0.1, abs=1e-5)
        assert laser.covariance[1, 1] < 0.01**2
        assert laser.covariance[2, 2] < 0.01**2


def test_no_step_is_unsure_by_more_than_the_robot_drives() -> None:
    """Into a hallway and out of it, after a break, and at the first step, which starts where the walls do."""
    walls = [[[1, 2], [12, 2]], [[1, 4], [12, 4]], [[1, 2], [1, 4]], [[12, 2], [12, 4]]]
    robot = {"start": (2, 3), "legs": [{"to": (11, 3)}, {"to": (2.5, 3), "backwards": True}]}
    laser = {"max_range": 3, "beams": 360, "field_of_view_deg": 360}
    drive = simulate_log(buildings.hallway(walls=walls, robot=robot, laser=laser))
    ranges = drive.log.ranges.copy()
    ranges[20] = np.nan
    motions = heard(with_ranges(drive, ranges))
    crossings = np.diff([motion.laser.open is not None for motion in motions])
    assert crossings.sum() >= 4
    for prior in priors(motions):
        for component in prior.components:
            assert np.diag(component.covariance)[:2].max() < 0.1**2
            assert component.covariance[2, 2] < 0.2**2


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
@pytest.mark.parametrize("now_open", [True, False], ids=["within", "at its end"])
def test_a_step_along_a_hallway_is_the_wheels_also_where_it_ends(now_open: bool, yaw: float) -> None:
    """Where the end comes into view the laser sees how far the way to it was, all at once: no step is that long."""
    sure, way = np.diag([1e-6, 1e-6, 1e-6]), np.array([math.cos(yaw), math.sin(yaw)])
    unsure = sure + 1e3 * np.outer([*way, 0.0], [*way, 0.0])
    start = np.array([3.0, 1.0, yaw])
    ends = [Match(start, unsure, 0.9, 0.9, way, False, 1)]
    ends.append(Match(compose(start, (0.4, 0.02, 0.01)), unsure, 0.9, 0.9, way, False, 1))
    if not now_open:
        ends[1] = dataclasses.replace(ends[1], covariance=sure, open=None)
    wheels, ranges = [np.zeros(3), np.array([0.1, 0.0, 0.03])], np.zeros(1, np.float32)
    motions = [Motion(0.2 * i, wheels[i], ends[i], None, wheels[i], ranges) for i in range(2)]
    (prior,) = priors(motions)
    np.testing.assert_allclose(prior.components[0].step, [0.1, 0.02, 0.01], atol=2e-3)
    assert prior.components[0].covariance[0, 0] == pytest.approx(first_of(prior, "wheels").covariance[0, 0], rel=0.05)
    assert prior.disagreement < AGREE


def test_along_a_hallway_a_robot_without_wheels_goes_on_at_its_speed() -> None:
    """It has seen its speed before the end behind it was out of range."""
    walls = [[[1, 2], [41, 2]], [[1, 4], [41, 4]], [[1, 2], [1, 4]]]
    laser = {"beams": 360, "field_of_view_deg": 360, "pose": (0, 0, 0)}
    drive = simulate_log(
        buildings.hallway(walls=walls, laser=laser, robot={"start": (4, 3), "legs": [{"to": (30, 3)}]})
    )
    motions = heard(drive.log, "laser")
    hidden = (drive.ground_truth.poses[:, 0] > 9.5) & (drive.ground_truth.poses[:, 0] < 29.0)
    assert hidden.sum() > 80
    assert all(motion.laser.open is not None for motion, there in zip(motions, hidden, strict=True) if there)
    assert_near(errors(drive, laser_poses(motions))[hidden[1:] & hidden[:-1]])
    for prior, there in zip(priors(motions, "laser"), hidden[1:] & hidden[:-1], strict=True):
        if there:
            assert prior.components[0].covariance[0, 0] > 0.02**2, "it may brake"


# --- wheels that say nonsense ----------------------------------------------------------------------------------------


def lying(log: Log, kind: str, since: int) -> Log:
    """A log whose wheels are wrong from a scan on: they count backwards, or spin, or jump by 80 degrees once."""
    told = steps(log.odometry)
    if kind == "reversed":
        told[since:, :2] *= -1.0
    elif kind == "spun":
        told[since:, 0] += 0.5
    else:
        told[since, 2] += math.radians(80.0) if kind == "turned left" else -math.radians(80.0)
    odometry = [log.odometry[0]]
    for step in told:
        odometry.append(compose(odometry[-1], step))
    return dataclasses.replace(log, odometry=np.array(odometry))


@pytest.mark.parametrize("kind", ["reversed", "spun", "turned left", "turned right"])
@pytest.mark.parametrize("building", [buildings.room, buildings.office], ids=["room", "office"])
def test_wheels_that_say_nonsense_are_seen_through(building: Any, kind: str) -> None:
    drive = simulate_log(building(), 2)
    motions = heard(lying(drive.log, kind, 30))
    assert_followed(drive, motions)
    wrong = errors(drive, wheel_poses(motions))
    off = (np.hypot(wrong[:, 0], wrong[:, 1]) > 0.1) | (np.abs(wrong[:, 2]) > 0.2)
    assert off.sum() >= (1 if kind.startswith("turned") else 60)
    for prior, bad in zip(priors(motions), off, strict=True):
        assert prior.components[0].name == "laser"
        if bad:
            assert prior.disagreement > 2 * AGREE
            assert first_of(prior, "wheels").share == 0.5


@pytest.mark.parametrize("kind", ["reversed", "spun"])
def test_in_a_hallway_wheels_cannot_be_contradicted(kind: str) -> None:
    """Whatever they say of the way along it; of the heading the walls know."""
    drive = simulate_log(buildings.hallway(), 2)
    motions = heard(lying(drive.log, kind, 30))
    told = steps(wheel_poses(motions))[30:]
    np.testing.assert_allclose(steps(laser_poses(motions))[30:, 0], told[:, 0], atol=0.01)
    assert np.mean([prior.disagreement > AGREE for prior in priors(motions)]) < 0.05
    turned = priors(heard(lying(drive.log, "turned left", 30)))
    assert turned[30].disagreement > 2 * AGREE


# --- how sure it says it is ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "building",
    [buildings.room, buildings.office, buildings.hard_braking, buildings.turning, buildings.turned_laser],
    ids=lambda building: building.__name__,
)
def test_witnesses_that_are_both_right_agree(building: Any) -> None:
    """99 of a hundred times, since that is how the bound is chosen; and the true step is within the laser's word."""
    apart, off = [], []
    for seed in range(4):
        drive = simulate_log(building(), seed)
        said = priors(heard(drive.log))
        apart += [prior.disagreement for prior in said]
        for prior, true in zip(said, steps(drive.ground_truth.poses), strict=True):
            error = prior.components[0].step - true
            error[2] = wrap_angle(error[2])
            off.append(float(error @ np.linalg.solve(prior.components[0].covariance, error)))
    assert np.isfinite(apart).all()
    assert np.mean(np.array(apart) < AGREE) > 0.98
    assert np.mean(np.array(off) < AGREE) > 0.98
    assert 0.2 < np.mean(off) < 4.0  # three degrees of freedom


def repeated(building: Building, times: int) -> tuple[Simulated, list[list[Motion]]]:
    """The same drive, measured again and again: other noise on every range, whose deviation is 15 mm."""
    silent = building.laser.model_dump() | buildings.silent
    drive = simulate_log(Building.model_validate(building.model_dump(exclude_none=True) | {"laser": silent}), 1)
    runs = []
    for seed in range(times):
        noise = np.random.default_rng(seed).normal(0.0, 0.015, drive.log.ranges.shape)
        runs.append(heard(with_ranges(drive, drive.log.ranges + noise)))
    return drive, runs


@pytest.mark.parametrize(
    "building",
    [buildings.room(), buildings.office(people=[]), buildings.turning(), buildings.turned_laser()],
    ids=lambda building: building.name,
)
def test_a_match_is_as_sure_as_it_is_good(building: Building) -> None:
    """Its covariance against the scatter over many drives: of the poses before drift has added up, and of all steps."""
    _, runs = repeated(building, 30)
    poses = np.array([laser_poses(motions) for motions in runs])
    claimed = np.array([[motion.laser.covariance for motion in motions[1:13]] for motions in runs]).mean(axis=0)
    scatter = poses[:, 1:13].std(axis=0)
    ratios = np.median(np.sqrt(np.diagonal(claimed, axis1=1, axis2=2)) / scatter, axis=0)
    assert (ratios > 0.5).all()
    assert (ratios < 2.0).all()
    told = np.array([[prior.components[0].covariance for prior in priors(motions)] for motions in runs]).mean(axis=0)
    scatter = np.std([steps(each) for each in poses], axis=0)
    ratios = np.median(np.sqrt(np.diagonal(told, axis1=1, axis2=2)) / scatter, axis=0)
    assert (ratios > 0.5).all()
    assert (ratios < 4.0).all()  # a step is never surer than the drift, which this scatter lacks


def test_points_turn_with_the_robot_and_their_covariance_too() -> None:
    """Driven the other way round, the same room is known as well: no axis of the frame is special."""
    there = simulate_log(buildings.room(), 6)
    turned = dataclasses.replace(there.log, odometry=compose((3.0, -1.0, 2.0), there.log.odometry))
    for a, b in zip(heard(there.log), heard(turned), strict=True):
        np.testing.assert_allclose(a.laser.pose, b.laser.pose, atol=1e-9)
        np.testing.assert_allclose(a.laser.covariance, b.laser.covariance, rtol=1e-6, atol=1e-12)
