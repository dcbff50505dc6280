"""A gyroscope is a third witness of the heading."""

from __future__ import annotations

import dataclasses
import itertools

import buildings
import numpy as np
import pytest
from priors import prior_of

from pipeline.config import Config
from pipeline.motion.witnesses import Motion, Witnesses
from pipeline.simulate import simulate_log

GYROSCOPE = {"rate": 100, "noise": 0.002, "bias": 0.0}


def test_some_particles_turn_as_the_gyroscope_says() -> None:
    before = Motion(0.0, np.zeros(3), None, 0.0, np.zeros(3), np.empty(0, np.float32))
    now = Motion(0.2, np.array([0.2, 0.0, 0.5]), None, 0.1, np.array([0.2, 0.0, 0.5]), np.empty(0, np.float32))
    # The laser has just begun anew, so that only the wheels and the gyroscope are heard.
    drive = simulate_log(buildings.room(), 0)
    witnesses = Witnesses(drive.log.laser, Config())
    match = witnesses.update(next(iter(drive.log.scans()))).laser
    assert match is not None
    broken = dataclasses.replace(match, stretch=match.stretch + 1)
    prior = prior_of(dataclasses.replace(before, laser=match), dataclasses.replace(now, laser=broken))
    turned, wheels = prior.components
    assert turned.name == "wheels, turned by the gyroscope"
    assert turned.step == pytest.approx([0.2, 0.0, 0.1])
    assert wheels.step[2] == pytest.approx(0.5)
    assert turned.share == pytest.approx(wheels.share)
    assert np.sqrt(turned.covariance[2, 2]) < 0.01


def test_a_gap_of_the_gyroscope_says_nothing() -> None:
    before = Motion(0.0, np.zeros(3), None, 0.0, np.zeros(3), np.empty(0, np.float32))
    now = dataclasses.replace(before, time=0.2, odometry=np.array([0.1, 0.0, 0.0]), turn=float("nan"))
    prior = prior_of(before, now, odometry="wheels")
    assert [component.name for component in prior.components] == ["wheels"]


def test_a_laser_that_turns_in_the_dark_is_guessed_where_the_gyroscope_says() -> None:
    """Once a second, without wheels, at up to 60 degrees a second: no step is like the one before."""
    drive = simulate_log(buildings.room(laser={"rate": 1.5}, imu=GYROSCOPE), 2)
    assert drive.log.turns is not None
    witnesses = Witnesses(drive.log.laser, Config(odometry="laser"))
    headings = np.unwrap([witnesses.update(scan).pose[2] for scan in drive.log.scans()])
    truth = np.unwrap(drive.ground_truth.poses[:, 2])
    errors = [
        abs((b - a) - (d - c))
        for (a, b), (c, d) in zip(itertools.pairwise(headings), itertools.pairwise(truth), strict=True)
    ]
    assert np.max(errors) < 0.05
