"""The extended Kalman filter: lines that are found where walls are, and a Gaussian that is as wide as it errs."""

from __future__ import annotations

import math

import buildings
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.filter.ekf import Ekf
from pipeline.filter.lines import NOISE, apart, find_lines, fit_line
from pipeline.geometry import compose, wrap_angle
from pipeline.localization import localize
from pipeline.motion.models import Component
from pipeline.simulate import simulate_log

ALL = np.arange(40)


def wall(alpha: float, r: float, begin: float, end: float, n: int = 40) -> np.ndarray:
    normal, along = np.array([math.cos(alpha), math.sin(alpha)]), np.array([-math.sin(alpha), math.cos(alpha)])
    return r * normal + np.linspace(begin, end, n)[:, None] * along


@given(st.floats(-3.1, 3.1), st.floats(0.2, 20.0), st.floats(-5.0, 4.0), st.floats(0.5, 6.0))
def test_a_line_is_where_its_points_are(alpha: float, r: float, begin: float, length: float) -> None:
    line = fit_line(wall(alpha, r, begin, begin + length), ALL)
    assert line.r == pytest.approx(r, abs=1e-6)
    assert wrap_angle(line.alpha - alpha) == pytest.approx(0.0, abs=1e-6)
    assert line.rms < 1e-9


@pytest.mark.parametrize(("begin", "end"), [(-1.0, 1.0), (2.0, 5.0), (-6.0, -1.0)])
def test_a_line_s_covariance_is_that_of_its_errors(begin: float, end: float) -> None:
    rng, exact = np.random.default_rng(1), wall(0.7, 3.0, begin, end)
    normal = np.array([math.cos(0.7), math.sin(0.7)])
    found = [fit_line(exact + NOISE * rng.standard_normal((40, 1)) * normal, ALL) for _ in range(3000)]
    errors = np.array([(wrap_angle(line.alpha - 0.7), line.r - 3.0) for line in found])
    np.testing.assert_allclose(np.cov(errors.T), found[0].covariance, rtol=0.12, atol=2e-6)


def test_walls_are_split_at_corners_and_jumps() -> None:
    corner = np.concatenate([wall(0.0, 2.0, -1.0, 2.0, 30), wall(math.pi / 2, 2.0, -2.0, 1.0, 30)])
    behind = wall(0.0, 5.0, -2.0, 2.0, 30)[::-1]
    lines = find_lines(np.concatenate([corner, np.full((3, 2), np.nan), behind]))
    assert [round(line.r, 1) for line in lines] == [2.0, 2.0, 5.0]
    assert find_lines(np.full((50, 2), np.nan)) == []
    assert find_lines(np.random.default_rng(0).uniform(-5, 5, (50, 2))) == []


def test_close_to_the_origin_a_normal_may_point_either_way() -> None:
    one, other = fit_line(wall(0.0, 0.02, -1.0, 1.0), ALL), fit_line(wall(0.0, -0.02, -1.0, 1.0), ALL)
    np.testing.assert_allclose(apart(other, one), [0.0, -0.04], atol=1e-6)


def at(pose: np.ndarray, drive) -> Ekf:
    config = Config(init="pose", initial_pose=tuple(pose.tolist()), initial_pose_std=(0.2, 0.2, 0.1))
    return Ekf(drive.log.grid, drive.log.laser, config, drive.log.laser.range_max)


def test_a_prediction_is_as_wide_as_robots_that_drive_it() -> None:
    drive, rng = simulate_log(buildings.room(), 0), np.random.default_rng(2)
    pose = drive.ground_truth.poses[0]
    filter_ = at(pose, drive)
    step = Component("step", np.array([0.5, 0.1, 0.2]), np.diag([0.02, 0.01, 0.03]) ** 2)
    blind = next(iter(drive.log.scans()))
    blind.ranges[:] = np.nan
    mean, covariance = filter_.update(blind, step)
    starts = pose + rng.standard_normal((200_000, 3)) * [0.2, 0.2, 0.1]
    ends = compose(starts, rng.multivariate_normal(step.step, step.covariance, 200_000))
    off = ends - mean
    off[:, 2] = wrap_angle(off[:, 2])
    np.testing.assert_allclose(np.cov(off.T), covariance, atol=2e-3)


@pytest.mark.parametrize("seed", range(3))
def test_it_errs_as_much_as_it_says(seed: int) -> None:
    drive = simulate_log(buildings.room(), seed)
    pose = compose(drive.ground_truth.poses[0], np.array([0.15, -0.1, 0.05]))
    config = Config(init="pose", initial_pose=tuple(pose.tolist()), initial_pose_std=(0.2, 0.2, 0.1), filter="ekf")
    found = localize(drive.log, config)
    truth = np.stack(
        [np.interp(found.stamps, drive.ground_truth.stamps, drive.ground_truth.poses[:, k]) for k in (0, 1)], axis=1
    )
    off = found.poses[:, :2] - truth
    nees = np.einsum("ni,nij,nj->n", off, np.linalg.inv(found.covariances[:, :2, :2]), off)
    assert np.median(np.hypot(*off.T)) < 0.06
    assert np.mean(nees) < 7.0  # of two degrees of freedom: walls err alike from scan to scan, and it does not know


def test_it_needs_a_start() -> None:
    drive = simulate_log(buildings.room(), 0)
    with pytest.raises(MclError, match=r"known start .*--pose"):
        localize(drive.log, Config(filter="ekf"))
