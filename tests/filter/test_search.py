"""The search of the building: one scan, every pose."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.filter.sensor import Sensor
from pipeline.geometry import wrap_angle
from pipeline.kernels.random import stream_key
from pipeline.logs.messages import Log

N = 4000


@pytest.fixture(scope="module")
def sensor(office: Log) -> Sensor:
    return Sensor(office.grid, office.laser, Config(occupied_threshold=0.65, range_bias=0.0))


def test_the_true_place_is_among_the_draws(office: Log, sensor: Sensor) -> None:
    """All along the drive: the posterior of one scan is wide, and the truth has more than its share of it."""
    truth = office.grid.to_grid(office.ground_truth.poses)
    share = []
    for scan in list(office.scans())[::60]:
        x, y, theta = sensor.search(sensor.read(scan.ranges), N, stream_key(0, scan.index, 0)).poses
        off = np.hypot(x - truth[scan.index, 0], y - truth[scan.index, 1])
        near = (off < 0.5) & (np.abs(wrap_angle(theta - truth[scan.index, 2])) < 0.2)
        share.append(near.mean())
    # 0.8 m^2 of some 500 m^2 and 0.4 rad of a turn: chance would give one draw in ten thousand.
    assert np.median(share) > 0.01
    assert np.mean(np.array(share) > 0.0005) > 0.8


def test_draws_stand_where_a_robot_can(office: Log, sensor: Sensor) -> None:
    """The laser in an open cell; the centre in a free one, give or take the width of a cell and a degree."""
    scan = next(iter(office.scans()))
    x, y, theta = sensor.search(sensor.read(scan.ranges), N, stream_key(0, 0, 0)).poses
    assert x.shape == (N,)
    assert np.abs(theta).max() <= np.float32(math.pi)
    col, row = np.floor(x / 0.1).astype(int), np.floor(y / 0.1).astype(int)
    free = office.grid.free(0.25)
    beside = [np.roll(free, (i, j), axis=(0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    assert np.any(beside, axis=0)[row, col].all()
    assert free[row, col].mean() > 0.9


def test_the_key_decides(office: Log, sensor: Sensor) -> None:
    reading = sensor.read(next(iter(office.scans())).ranges)
    first, again, other = (sensor.search(reading, N, stream_key(k, 0, 0)).poses for k in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def poses_without_a_word(office: Log, sensor: Sensor) -> np.ndarray:
    scan = dataclasses.replace(next(iter(office.scans())), ranges=np.full(180, np.nan, np.float32))
    return sensor.search(sensor.read(scan.ranges), N, stream_key(0, 0, 0)).poses


def test_a_scan_that_says_nothing_leaves_every_place_open(office: Log, sensor: Sensor) -> None:
    x, y, _ = poses_without_a_word(office, sensor)
    rows, cols = np.nonzero(office.grid.free(0.25))
    assert x.mean() == pytest.approx(cols.mean() * 0.1, abs=1.0)
    assert y.mean() == pytest.approx(rows.mean() * 0.1, abs=1.0)
    assert x.std() == pytest.approx(cols.std() * 0.1, rel=0.1)
    assert y.std() == pytest.approx(rows.std() * 0.1, rel=0.1)


def test_a_scan_that_says_nothing_leaves_every_heading_open(office: Log, sensor: Sensor) -> None:
    _, _, theta = poses_without_a_word(office, sensor)
    assert abs(np.exp(1j * theta).mean()) < 0.1


def test_no_cell_to_stand_in(office: Log) -> None:
    with pytest.raises(MclError, match="no free cell"):
        Sensor(office.grid, office.laser, Config(free_threshold=0.0))
