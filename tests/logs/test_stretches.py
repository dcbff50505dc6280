"""Stamps that run backwards begin a new stretch; odometry that leaps is handed on as it was recorded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from drives import FRAMES, START, Moment, looped, moments, ordinary_drive, read, remarks, scan, steps

from pipeline.logs.stretches import FAR, GAP, numbered
from recordings import UPRIGHT, Recording

SECOND = 1_000_000_000


@pytest.mark.parametrize("received", [False, True])
@pytest.mark.parametrize("times", [2, 3])
def test_a_drive_that_is_played_again(tmp_path: Path, times: int, received: bool) -> None:
    base = read(ordinary_drive(), tmp_path)
    log = read(looped(times, received), tmp_path)
    assert len(log) == times * 60
    assert log.stretches is not None
    assert np.bincount(log.stretches).tolist() == [60] * times
    assert [each.stretch for each in log.scans()] == log.stretches.tolist()
    assert (np.diff(log.stamps) > 0).all()
    for k in range(times):
        part = slice(60 * k, 60 * (k + 1))
        np.testing.assert_array_equal(np.diff(log.stamps[part]), np.diff(base.stamps))
        np.testing.assert_array_equal(log.ranges[part], base.ranges)
        np.testing.assert_allclose(steps(log)[60 * k : 60 * k + 59], steps(base), atol=1e-9)
    assert np.diff(log.stamps)[59] == GAP
    np.testing.assert_allclose(steps(log)[59], 0.0, atol=1e-12)  # nobody knows; it is no drive back to the start
    assert "the stamps of /scan run back by" in remarks(log)
    assert "at message 61" in remarks(log)


def test_one_stretch_has_no_number(tmp_path: Path) -> None:
    log = read(ordinary_drive(), tmp_path)
    assert log.stretches is None
    assert {each.stretch for each in log.scans()} == {0}


def test_a_gyroscope_does_not_turn_from_one_stretch_to_the_next(tmp_path: Path) -> None:
    log = read(looped(2, False, imu=True), tmp_path)
    assert log.turns is not None
    assert np.isnan(log.turns[60])
    assert np.isfinite(log.turns[:60]).all()


def test_where_only_the_odometry_begins_anew(tmp_path: Path) -> None:
    """The scans' topic was there from the second time on: the odometry of the first says nothing of them."""
    recording = looped(2, False)
    scans = [entry for entry in recording.entries if entry[0] == "/scan"]
    for entry in scans[:60]:
        recording.entries.remove(entry)
    log = read(recording, tmp_path)
    np.testing.assert_allclose(steps(log), steps(read(ordinary_drive(), tmp_path)), atol=1e-9)


# --- numbers of stretches


@pytest.mark.parametrize(
    ("seconds", "expected"),
    [
        ([0, 1, 2, 3], None),
        ([0, 1, 0.5, 2, 1.5, 3], None),  # late, as over a network
        ([*range(9), *range(9)], [0] * 9 + [1] * 9),
        ([0, 10, 20, 3, 30, 40], [0, 0, 0, 0, 0, 0]),  # one that was very late
        ([*range(9), *range(9), 3, 4, 5], [0] * 9 + [1] * 9 + [2] * 3),
        ([1000, 1001, 0, 1002, 1003], [0, 0, -1, 0, 0]),  # a stamp that nobody filled in
        ([1000, 1001, 9000, 1002, 1003, 1004, 1005], [0, 0, -1, 0, 0, 0, 0]),  # one from the future
    ],
)
def test_what_begins_anew_and_what_is_late(seconds: list[float], expected: list[int] | None) -> None:
    number = numbered(np.array([round(s * SECOND) for s in seconds], np.int64))
    assert (None if number is None else number.tolist()) == expected
    assert FAR == 60 * SECOND


# --- odometry that is reset


def driven(poses: dict[int, tuple[float, float, float]], after: int = 0, at: tuple[float, float, float] | None = None):
    """The drive with other poses here and there; from ``after`` on as if it had been at ``at`` there."""
    from pipeline.geometry import between, compose

    recording = Recording()
    recording.transforms(("base_link", "laser", (0.25, 0.0, 0.3), UPRIGHT))
    for i, moment in enumerate(moments()):
        told = np.array(poses.get(i, moment.pose))
        if at is not None and i >= after:
            told = compose(at, between(moments()[after].pose, moment.pose))
        recording.odometry(moment.stamp, *told.tolist(), topic="/odom", frames=FRAMES)
        scan(recording, moment)
    return recording


@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), (-50.0, 30.0, 2.0)])
def test_odometry_that_starts_again_is_handed_on_as_it_was_recorded(
    tmp_path: Path, at: tuple[float, float, float]
) -> None:
    base, log = read(ordinary_drive(), tmp_path), read(driven({}, 40, at), tmp_path)
    assert log.stretches is None  # the robot itself was not carried
    assert remarks(log) == ""
    np.testing.assert_allclose(log.odometry[:40], base.odometry[:40], atol=1e-12)
    np.testing.assert_allclose(log.odometry[40], at, atol=1e-12)
    np.testing.assert_allclose(np.delete(steps(log), 39, 0), np.delete(steps(base), 39, 0), atol=1e-9)


def test_nobody_is_half_way_of_a_leap() -> None:
    from pipeline.logs.columns import planar_poses
    from pipeline.logs.odometry import odometry_at

    stamps = np.arange(4) * SECOND // 10
    told = np.array([[20.0, 1.0, 0.0], [20.1, 1.0, 0.0], [0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
    between_them = stamps[:3] + SECOND // 20
    poses, _ = odometry_at(between_them, np.zeros(3, np.int64), planar_poses(stamps, stamps, told, "odom", "base_link"))
    np.testing.assert_allclose(poses, [[20.05, 1.0, 0.0], [20.1, 1.0, 0.0], [0.05, 0.0, 0.0]], atol=1e-12)


def test_a_fast_drive_through_a_gap_in_the_recording_is_a_drive(tmp_path: Path) -> None:
    recording = Recording()
    recording.transforms(("base_link", "laser", (0.25, 0.0, 0.3), UPRIGHT))
    for i in range(60):
        stamp = START + i * SECOND // 10 + (30 * SECOND if i >= 30 else 0)
        x = 0.05 * i + (20.0 if i >= 30 else 0.0)
        recording.odometry(stamp, x, 0.0, 0.0, topic="/odom", frames=FRAMES)
        scan(recording, Moment(stamp, (x, 0.0, 0.0), moments()[0].ranges))
    log = read(recording, tmp_path)
    assert remarks(log) == ""
    assert log.odometry[-1, 0] == pytest.approx(0.05 * 59 + 20.0)
