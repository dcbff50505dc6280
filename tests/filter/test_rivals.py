"""Rivals: places followed one by one, all in the same arrays."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from pipeline.config import Config
from pipeline.filter.rivals import APART_D, EACH, Rivals, same_place
from pipeline.filter.sensor import Sensor
from pipeline.geometry import compose
from pipeline.logs.messages import Log, Scan
from pipeline.motion.models import motion_model
from pipeline.motion.prior import Prior, motion_prior
from pipeline.motion.witnesses import Motion

NOBODY = np.empty((0, 3))
CONFIG = Config(occupied_threshold=0.65, range_bias=0.0)


@pytest.fixture(scope="module")
def sensor(office: Log) -> Sensor:
    return Sensor(office.grid, office.laser, CONFIG)


def crowd(*places: tuple[float, float, float], n: int = 500) -> np.ndarray:
    """Draws of a search, (3, n) each around a place; fewer and fewer."""
    rng = np.random.default_rng(0)
    return np.hstack([rng.normal(place, 0.02, (n // (1 + i), 3)).T for i, place in enumerate(places)]).astype(
        np.float32
    )


def by_wheels(*scans: Scan) -> Prior:
    """How the robot moved between two scans, as its wheels say."""
    before, now = (Motion(scan.time, scan.odometry, None, None, scan.odometry, scan.ranges) for scan in scans)
    return motion_prior(before, now, CONFIG, motion_model(CONFIG))


def test_the_densest_places_first_and_none_twice(sensor: Sensor) -> None:
    a, b, c = (3.5, 3.5, 0.25), (9.5, 3.5, 0.25), (3.5, 3.5, 2.8)
    rivals = Rivals(sensor, 0, 1)
    assert rivals.find(crowd(a, b, c), NOBODY, 2, time=4.0, margin=10.0) == 2
    np.testing.assert_allclose(rivals.poses, [a, b], atol=0.01)
    np.testing.assert_array_equal(rivals.began, [4.0, 4.0])
    assert rivals.find(crowd(a, b, c), NOBODY, 9, time=5.0, margin=10.0) == 1, "two of the three are followed already"
    np.testing.assert_allclose(rivals.poses[2], c, atol=0.01)
    assert rivals.find(crowd(a, b), np.array([(20.0, 3.5, 0.25)]), 9, time=6.0, margin=10.0) == 0
    assert rivals.find(crowd((20.0, 3.5, 0.25)), np.array([(20.3, 3.5, 0.25)]), 9, time=6.0, margin=10.0) == 0, "taken"


def test_rivals_drive_with_the_robot_and_find_their_place(office: Log, sensor: Sensor) -> None:
    """One starts beside the truth, one across the building: the first ends on it, the other drives the same way."""
    scans, truth = list(office.scans())[:120], office.grid.to_grid(office.ground_truth.poses)
    start = truth[0] + np.array([0.25, -0.2, 0.05])
    rivals = Rivals(sensor, 0, 1)
    spread = np.random.default_rng(1).normal(0.0, [[0.2], [0.2], [0.05]], (3, 4000))
    rivals.find((start[:, None] + spread).astype(np.float32), NOBODY, 1, 0.0, 10.0)
    for before, scan in itertools.pairwise(scans):
        prior = by_wheels(before, scan)
        rivals.follow(prior, sensor.read(scan.ranges), scan.index)
    assert np.hypot(*(rivals.poses[0] - truth[119])[:2]) < 0.2
    np.testing.assert_allclose(rivals.weights.sum(axis=1), 1.0)


def test_a_rival_does_not_depend_on_the_others_that_come_after_it(office: Log, sensor: Sensor) -> None:
    """And leaving one out leaves the rest where they were, also in memory."""
    scans, place = list(office.scans())[:10], office.grid.to_grid(office.ground_truth.poses[0])
    few, many = (Rivals(sensor, 7, 1) for _ in range(2))
    few.find(crowd(tuple(place)), NOBODY, 1, 0.0, 10.0)
    many.find(crowd(tuple(place), (1.0, 1.0, 0.0)), NOBODY, 2, 0.0, 10.0)
    for before, scan in itertools.pairwise(scans):
        prior = by_wheels(before, scan)
        for rivals in (few, many):
            rivals.follow(prior, sensor.read(scan.ranges), scan.index)
    np.testing.assert_array_equal(few.particles[:, 0], many.particles[:, 0])
    last = many.poses[1].copy()
    many.keep(np.array([1]))
    np.testing.assert_array_equal(many.poses, [last])
    assert many.particles.flags.c_contiguous, "following works on a flat view of it"


def test_a_belief_that_lost_its_place_is_followed_on(sensor: Sensor) -> None:
    rivals = Rivals(sensor, 0, 1)
    poses = crowd((2.0, 2.0, math.pi - 0.01), n=1000)
    poses[2] = (poses[2] + np.float32(math.pi)) % np.float32(2 * math.pi) - np.float32(math.pi)
    rivals.adopt(poses, np.full(1000, 1e-3), time=9.0, scan=3, margin=4.0)
    assert rivals.particles.shape == (3, 1, EACH)
    np.testing.assert_array_equal(rivals.margin, [4.0])
    assert same_place(rivals.poses[0], np.array([2.0, 2.0, math.pi]))
    assert np.sqrt(np.diag(rivals.covariance(0))) == pytest.approx([0.02] * 3, rel=0.2)


def test_same_place() -> None:
    here = np.array([1.0, 1.0, 3.1])
    assert same_place(here, np.array([1.0, 1.0 + 0.9 * APART_D, -3.1]))
    assert not same_place(here, np.array([1.0, 1.0 + 1.1 * APART_D, 3.1]))
    assert not same_place(here, compose(here, (0.0, 0.0, 0.6)))
