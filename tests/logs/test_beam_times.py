"""When the beams of a scan were measured, and how the odometry moved from the first of them to the last."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pipeline.geometry import between
from pipeline.logs.messages import Log
from pipeline.logs.reader import read_log
from recordings import UPRIGHT, UPSIDE_DOWN, Quaternion, Recording

SECOND = 1_000_000_000


def turning(mount: Quaternion = UPRIGHT, *, scans: int = 10, odometry_until: float = 3.0, **scan: object) -> Recording:
    """Scans of 101 beams at 5 Hz, a millisecond from beam to beam, and odometry at 20 Hz that drives in a circle."""
    recording = Recording()
    recording.transforms(("base", "laser", (0.2, 0.0, 0.3), mount))
    for i in range(int(odometry_until * 20) + 1):
        t = i / 20
        yaw, stamp = 0.8 * t, round(t * SECOND)
        recording.odometry(stamp, math.sin(yaw), 1 - math.cos(yaw), yaw, frames=("odom", "base"))
    for i in range(scans):
        options: dict[str, object] = {"first": -1.0, "step": 0.02, "frame": "laser"} | scan
        recording.scan((i + 1) * SECOND // 5, [2.0] * 101, **options)  # type: ignore[arg-type]
    return recording


def read(recording: Recording, tmp_path: Path) -> Log:
    return read_log(recording.write(tmp_path / "a.mcap"))


def on_the_way(first: float, last: float) -> np.ndarray:
    """The robot's motion between two moments, s."""
    a, b = ([math.sin(0.8 * t), 1 - math.cos(0.8 * t), 0.8 * t] for t in (first, last))
    return between(a, b)


@pytest.mark.parametrize(
    ("mount", "scan", "expected"),
    [
        (UPRIGHT, {}, 0.001),
        (UPRIGHT, {"first": 1.0, "step": -0.02}, -0.001),
        (UPSIDE_DOWN, {}, -0.001),
        (UPSIDE_DOWN, {"first": 1.0, "step": -0.02}, 0.001),
        (UPRIGHT, {"time_increment": 0.0}, 0.0),
        (UPSIDE_DOWN, {"time_increment": 0.0}, 0.0),
    ],
)
def test_the_time_from_beam_to_beam_follows_their_order(
    tmp_path: Path, mount: Quaternion, scan: dict[str, float], expected: float
) -> None:
    log = read(turning(mount, **scan), tmp_path)
    assert (log.laser.time_increment, math.copysign(1.0, log.laser.time_increment)) == (
        expected,
        math.copysign(1.0, expected),
    )
    assert (log.sweeps is None) == (expected == 0.0)


def test_the_sweep_is_the_motion_from_the_first_beam_to_the_last(tmp_path: Path) -> None:
    log = read(turning(), tmp_path)
    assert log.sweeps is not None
    assert log.sweeps.shape == (10, 3)
    for scan in log.scans():
        stamp = scan.stamp / 1e9
        np.testing.assert_allclose(scan.sweep, on_the_way(stamp, stamp + 0.1), atol=1e-9)
    np.testing.assert_allclose(log.sweeps[:, 2], 0.08, atol=1e-12)


def test_it_follows_the_stamps_whatever_the_order_of_the_beams(tmp_path: Path) -> None:
    upright, turned_over = read(turning(), tmp_path), read(turning(UPSIDE_DOWN), tmp_path)
    np.testing.assert_array_equal(upright.sweeps, turned_over.sweeps)


def test_a_scan_that_outlasts_the_odometry_moves_as_far_as_that_goes(tmp_path: Path) -> None:
    log = read(turning(odometry_until=1.05), tmp_path)
    assert len(log) == 5
    assert log.sweeps is not None
    np.testing.assert_allclose(log.sweeps[3], on_the_way(0.8, 0.9), atol=1e-9)
    np.testing.assert_allclose(log.sweeps[4], on_the_way(1.0, 1.05), atol=1e-9)


def test_a_robot_at_rest_has_no_sweep_to_the_last_bit(tmp_path: Path) -> None:
    recording = Recording()
    for i in range(40):
        recording.odometry(i * SECOND // 20, 0.1, -0.3, 2.7, frames=("odom", "laser"))
    for i in range(5):
        recording.scan(i * SECOND // 5 + 12_345_678, [2.0] * 101, frame="laser")
    log = read(recording, tmp_path)
    np.testing.assert_array_equal(log.sweeps, np.zeros((5, 3)))


def test_odometry_that_jumps_is_no_motion(tmp_path: Path) -> None:
    recording = turning(odometry_until=0.5)
    for i in range(10, 40):
        recording.odometry(i * SECOND // 20 + SECOND // 20, 500.0, 0.0, 0.0, frames=("odom", "base"))
    log = read(recording, tmp_path)
    assert log.sweeps is not None
    assert np.abs(log.sweeps).max() < 1.0


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 0.0031, -0.0031, 1e9])
def test_a_time_that_cannot_be_is_not_used_and_told(tmp_path: Path, wrong: float) -> None:
    """101 beams, 0.2 s from scan to scan."""
    log = read(turning(time_increment=wrong), tmp_path)
    assert (log.laser.time_increment, log.sweeps) == (0.0, None)
    assert "beam" in log.metadata["reader"]["beam_times_unused"]


@pytest.mark.parametrize("time_increment", [0.0019, 0.0029])
def test_a_scan_may_take_all_of_the_time_to_the_next(tmp_path: Path, time_increment: float) -> None:
    log = read(turning(time_increment=time_increment), tmp_path)
    assert log.laser.time_increment == pytest.approx(time_increment)
    assert "beam_times_unused" not in log.metadata["reader"]


def test_a_pace_that_varies_from_scan_to_scan_is_its_median(tmp_path: Path) -> None:
    recording = turning(scans=0)
    for i, pace in enumerate([0.0009, 0.001, 0.0011, 0.001, 0.0012]):
        recording.scan((i + 1) * SECOND // 5, [2.0] * 101, frame="laser", time_increment=pace)
    recording.scan(6 * SECOND // 5, [2.0] * 90, frame="laser", time_increment=0.5)
    assert read(recording, tmp_path).laser.time_increment == 0.001
