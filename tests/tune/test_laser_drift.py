"""The drift of the laser's odometry: recovered where it is known, and left as it was where nothing tells."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pipeline.config import Config
from pipeline.evaluate.metrics import interpolate
from pipeline.geometry import between, compose
from pipeline.logs.messages import Log
from pipeline.simulate import simulate_log
from pipeline.tune import tune
from pipeline.tune.drift import DRIFTS, SMALLEST, WINDOWS, drift_windows, fit_drift
from pipeline.tune.learning import ALPHAS, _find
from pipeline.tune.preset import preset
from pipeline.tune.way import Way
from tests import buildings

KNOWN = {"laser_drift_d": 0.02, "laser_drift_a": 0.006}
SQUARE = [{"to": [7, 2.6]}, {"to": [7, 5.4]}, {"to": [3, 5.4]}, {"to": [3, 2.6]}]


def drive(n: int, seed: int, jitter: tuple[float, float] = (0.0, 0.0), d: float = 0.02, a: float = 0.006):
    """A way whose laser drifts as the motion prior has it, and the trajectory with white noise."""
    rng = np.random.default_rng(seed)
    true, laser = np.zeros((n, 3)), np.zeros((n, 3))
    laser[0] = 3.0, -2.0, 1.0  # in a frame of its own
    for k in range(1, n):
        move = np.array([(0.15, 0.0, 0.0), (0.1, 0.0, 0.06), (0.15, 0.0, -0.03), (0.0, 0.0, -0.1)][k // 25 % 4])
        true[k] = compose(true[k - 1], move)
        driven = np.hypot(*move[:2]) + 0.5 * abs(move[2])
        laser[k] = compose(laser[k - 1], move + rng.normal(size=3) * np.sqrt(driven) * [d, d, a])
    poses = true + rng.normal(size=true.shape) * [jitter[0], jitter[0], jitter[1]]
    closed, ranges = np.zeros(n, bool), np.empty((n, 1), np.float32)
    return Way(true, True, laser, np.zeros(n, np.int64), closed, ranges), poses


def learn(way: Way, poses: np.ndarray, scans: np.ndarray | None = None) -> Config:
    every = np.arange(len(poses))
    return fit_drift([drift_windows(way, poses, every, every if scans is None else scans)], Config()).config


@pytest.mark.parametrize("jitter", [(0.0, 0.0), (0.02, 0.01)])
def test_known_drift_is_recovered(jitter: tuple[float, float]) -> None:
    rows = []
    for seed in range(3):
        way, poses = drive(6000, seed, jitter)
        rows.append(drift_windows(way, poses, np.arange(6000), np.arange(6000)))
    fit = fit_drift(rows, Config())
    for name in DRIFTS:
        assert getattr(fit.config, name) == pytest.approx(KNOWN[name], rel=0.2), name
    # Two poses err at the ends of a window.
    assert np.sqrt(fit.jitter[0]) == pytest.approx(np.sqrt(2) * jitter[0], abs=0.015)
    assert np.sqrt(fit.jitter[1]) == pytest.approx(np.sqrt(2) * jitter[1], abs=0.007)


def test_a_heading_that_errs_is_no_drift_of_the_place() -> None:
    way, poses = drive(6000, 0, (0.0, 0.01), d=0.0, a=0.01)
    learned = learn(way, poses)
    assert learned.laser_drift_d < 0.005
    assert learned.laser_drift_a == pytest.approx(0.01, rel=0.3)


def test_a_perfect_laser_still_leaves_the_filter_some_noise() -> None:
    way, poses = drive(3000, 0, d=0.0, a=0.0)
    learned = learn(way, poses)
    assert tuple(getattr(learned, name) for name in DRIFTS) == SMALLEST


def test_breaks_leaps_and_gaps_are_not_the_laser_s() -> None:
    way, poses = drive(6000, 1, (0.01, 0.005))
    clean = learn(way, poses)
    assert way.laser is not None
    # A break: from there on the laser is elsewhere, and says so.
    leap, stretch = way.laser.copy(), way.stretch.copy()
    leap[2000:] = compose((0.3, -0.4, 0.3), leap[2000:])
    stretch[2000:] = 1
    # Hindsight leaps a little, and for a while is trusted nowhere.
    poses = poses.copy()
    poses[4000:] += [0.4, 0.3, 0.0]
    scans = np.delete(np.arange(6000), slice(3000, 3400))
    found = learn(dataclasses.replace(way, laser=leap, stretch=stretch), poses, scans)
    for name in DRIFTS:
        assert getattr(found, name) == pytest.approx(getattr(clean, name), rel=0.25), name


def test_windows_leave_out_no_update() -> None:
    way, poses = drive(2000, 0)
    every = np.arange(2000)
    whole = drift_windows(way, poses, every, every)
    assert whole[:, 0].min() >= WINDOWS[0]
    assert len(drift_windows(way, poses, every, every[::2])) == 0
    assert len(drift_windows(way, poses, every[::2], every[::2])) > 0


def test_a_direction_left_open_is_the_wheels_and_not_the_laser_s() -> None:
    way, poses = drive(6000, 2)
    assert way.laser is not None
    laser, opened = way.laser.copy(), way.open.copy()
    opened[3000:] = True
    steps = between(laser[:-1], laser[1:])
    steps[3000:, 0] *= 1.1
    for k, step in enumerate(steps):
        laser[k + 1] = compose(laser[k], step)
    found = learn(dataclasses.replace(way, laser=laser, open=opened), poses)
    assert found.laser_drift_d == pytest.approx(KNOWN["laser_drift_d"], rel=0.25)
    # Its heading holds all the same.
    assert found.laser_drift_a == pytest.approx(KNOWN["laser_drift_a"], rel=0.25)


def test_too_short_a_drive_leaves_the_drift_as_it_was() -> None:
    way, poses = drive(100, 0)
    every = np.arange(100)
    fit = fit_drift([drift_windows(way, poses, every, every)], Config())
    assert fit.config == Config()
    assert np.isnan(fit.jitter).all()
    assert len(drift_windows(way, poses, every, every[:1])) == 0


@pytest.fixture(scope="module")
def driven() -> Log:
    """Three times round a room whose laser errs by 1.5 cm."""
    return simulate_log(buildings.room(robot={"legs": 3 * SQUARE}), seed=4).log


def few(log: Log, **changes: object) -> Config:
    """Starts where the robot was: finding it is not what is tested here."""
    assert log.ground_truth is not None
    x, y, yaw = log.ground_truth.poses[0].tolist()
    start = {"init": "pose", "initial_pose": (x, y, yaw), "max_particles": 1000, "min_particles": 500}
    return Config.model_validate({**start, "recovery": "none", **changes})


def test_hindsight_tells_the_drift_in_a_building_as_the_truth_does(driven: Log) -> None:
    """Hindsight's own errors last for metres, so that it finds some more drift than there is; but not much."""
    found = _find(driven, few(driven), 0, None)
    assert driven.ground_truth is not None
    truth = interpolate(driven.ground_truth, driven.stamps)
    by_truth = fit_drift([drift_windows(found.way, truth, found.updates, found.scans)], Config()).config
    by_hindsight = fit_drift([drift_windows(found.way, found.trajectory, found.updates, found.scans)], Config()).config
    for name, some_more in (("laser_drift_d", 0.008), ("laser_drift_a", 0.003)):
        assert getattr(by_truth, name) < getattr(Config(), name), name
        assert abs(getattr(by_hindsight, name) - getattr(by_truth, name)) < some_more, name


@pytest.mark.slow
def test_a_robot_without_wheels_teaches_the_laser_s_drift_alone(driven: Log) -> None:
    legless = dataclasses.replace(driven, wheels=False, odometry=np.zeros_like(driven.odometry))
    for log, changes in ((legless, {}), (driven, {"odometry": "laser"})):
        start = few(log, **changes)
        learned = tune([log], start)
        assert all(getattr(learned.after, name) == getattr(start, name) for name in ALPHAS)
        assert learned.after.laser_drift_d != start.laser_drift_d
        (remark,) = learned.remarks
        assert "alpha1 to alpha4" in remark
        assert "no wheels" in remark
        assert remark in preset(learned)
        assert learned.to_dict()["remarks"] == [remark]


@pytest.mark.slow
def test_wheels_alone_teach_nothing_of_the_laser(driven: Log) -> None:
    start = few(driven, odometry="wheels")
    learned = tune([driven], start)
    assert all(getattr(learned.after, name) == getattr(start, name) for name in DRIFTS)
    assert any(getattr(learned.after, name) != getattr(start, name) for name in ALPHAS)
    (remark,) = learned.remarks
    assert "laser_drift_d and laser_drift_a" in remark
    assert np.isnan(learned.drift.jitter).all()
