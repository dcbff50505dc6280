"""Logs without odometry: the laser alone says how the robot moves, and the robot is found all the same."""

from __future__ import annotations

import dataclasses
import math

import buildings
import numpy as np
import pytest

from pipeline.config import Config
from pipeline.localization import RunResult, localize
from pipeline.logs.messages import Log
from pipeline.simulate import simulate_log

SEEDS = range(2)


def bare(log: Log) -> Log:
    """The log as if nobody had recorded odometry."""
    return dataclasses.replace(log, odometry=np.zeros_like(log.odometry), wheels=False, sweeps=None)


def run(log: Log, seed: int, *, known: bool, **values) -> RunResult:
    start = {"init": "pose", "initial_pose": tuple(log.ground_truth.poses[0].tolist())} if known else {}
    return localize(bare(log), Config(**start, **values), seed=seed)


def assert_there(log: Log, result: RunResult) -> None:
    """At the end within 0.5 m, and in hindsight all along."""
    truth = log.ground_truth.poses
    assert math.dist(result.poses[-1, :2], truth[-1, :2]) < 0.5
    assert abs(math.remainder(result.poses[-1, 2] - truth[-1, 2], 2 * math.pi)) < 0.1
    assert result.hindsight is not None
    assert np.median(np.hypot(*(result.hindsight - truth)[:, :2].T)) < 0.3


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("known", [True, False], ids=["known start", "unknown start"])
def test_in_the_embedded_office(office: Log, known: bool, seed: int) -> None:
    assert_there(office, run(office, seed, known=known))


@pytest.mark.parametrize("seed", [SEEDS[0], *(pytest.param(seed, marks=pytest.mark.slow) for seed in SEEDS[1:])])
@pytest.mark.parametrize("known", [True, False], ids=["known start", "unknown start"])
@pytest.mark.parametrize("name", ["office", "room", "apartment"])
def test_in_other_buildings(name: str, known: bool, seed: int) -> None:
    building = buildings.described(name) if name in buildings.DESCRIBED else getattr(buildings, name)()
    drive = simulate_log(building, 7 + seed)
    assert_there(drive.log, run(drive.log, seed, known=known))


def test_whether_wheels_are_missing_or_not_heard_is_the_same(office: Log) -> None:
    """But for the pose from which dead reckoning starts, which no pose on the map depends on."""
    values = {"odometry": "laser", "max_particles": 2000, "min_particles": 500}
    truth = tuple(office.ground_truth.poses[0].tolist())
    config = Config(init="pose", initial_pose=truth, **values)
    deaf, missing = (localize(log, config, seed=1) for log in (office, bare(office)))
    np.testing.assert_allclose(deaf.poses, missing.poses, atol=0.05)
