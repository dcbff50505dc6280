"""Headings by a gyroscope: how it is mounted, what it gets wrong, and that nothing looks ahead."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pipeline.logs.columns import GyroscopeColumns, planar_poses
from pipeline.logs.gyroscope import turns_at
from pipeline.logs.messages import Log
from pipeline.logs.reader import read_log
from recordings import UPRIGHT, UPSIDE_DOWN, Quaternion, Recording, link, yaw

SECOND = 1_000_000_000
ON_ITS_SIDE: Quaternion = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))  # rolled by a quarter: its y axis points up


def turning(rates: tuple[float, float, float], mount: Quaternion | None = UPRIGHT, **imu: object) -> Recording:
    """2 s of an IMU at 100 Hz that measures these rates, and scans at 5 Hz; odometry that says nothing of a turn."""
    recording = Recording()
    recording.transforms(("base", "laser", (0.2, 0.0, 0.3), UPRIGHT))
    if mount is not None:
        recording.transforms(("base", "imu_link", (0.0, 0.1, 0.2), mount))
    for i in range(201):
        recording.imu(i * SECOND // 100, rates, **imu)  # type: ignore[arg-type]
    for i in range(11):
        recording.odometry(i * SECOND // 5, 0.1 * i, 0.0, 0.0, frames=("odom", "base"))
        recording.scan(i * SECOND // 5, [1.0, 2.0], frame="laser", time_increment=0.0)
    return recording


def read(recording: Recording, tmp_path: Path) -> Log:
    return read_log(recording.write(tmp_path / "a.mcap"))


def turns(log: Log) -> np.ndarray:
    assert log.turns is not None
    return log.turns - log.turns[0]


def gyroscope(stamps, rates) -> GyroscopeColumns:
    return GyroscopeColumns(np.asarray(stamps, np.int64), np.asarray(rates, np.float64))


def at(seconds) -> np.ndarray:
    return np.round(np.asarray(seconds) * 1e9).astype(np.int64)


@pytest.mark.parametrize(
    ("rates", "mount", "expected"),
    [
        ((0.0, 0.0, 0.5), UPRIGHT, 0.5),
        ((0.0, 0.0, 0.5), yaw(2.0), 0.5),
        ((0.0, 0.0, 0.5), UPSIDE_DOWN, -0.5),
        ((0.0, 0.5, 0.1), ON_ITS_SIDE, 0.5),
        ((0.3, 0.2, 0.0), UPRIGHT, 0.0),
    ],
)
def test_the_turn_about_the_robots_vertical_axis(
    tmp_path: Path, rates: tuple[float, float, float], mount: Quaternion, expected: float
) -> None:
    log = read(turning(rates, mount), tmp_path)
    np.testing.assert_allclose(turns(log), expected * log.times, atol=1e-9)
    assert [scan.turn for scan in log.scans()] == log.turns.tolist()  # type: ignore[union-attr]
    assert log.metadata["reader"]["imu_topic"] == "/imu/data"


def test_a_recording_without_an_imu_has_no_turns(tmp_path: Path) -> None:
    recording = turning((0.0, 0.0, 0.5))
    recording.entries = [entry for entry in recording.entries if "Imu" not in entry[1]]
    log = read(recording, tmp_path)
    assert log.turns is None
    assert not any(key.startswith("imu") for key in log.metadata["reader"])


def test_the_robots_own_frame_needs_no_transform(tmp_path: Path) -> None:
    log = read(turning((0.0, 0.0, 0.5), None, frame="base"), tmp_path)
    np.testing.assert_allclose(turns(log), 0.5 * log.times, atol=1e-9)


def test_of_several_the_busiest_is_taken(tmp_path: Path) -> None:
    recording = turning((0.0, 0.0, 0.5))
    for i in range(20):
        recording.imu(i * SECOND // 10, (0.0, 0.0, 9.0), topic="/camera/imu")
    assert turns(read(recording, tmp_path))[-1] == pytest.approx(1.0)


def test_without_odometry_and_without_transforms(tmp_path: Path) -> None:
    recording = turning((0.0, 0.0, 0.5))
    recording.entries = [e for e in recording.entries if "Odometry" not in e[1] and "TF" not in e[1]]
    log = read(recording, tmp_path)
    assert not log.wheels
    np.testing.assert_allclose(turns(log), 0.5 * log.times, atol=1e-9)


@pytest.mark.parametrize("why", ["no mount", "moves", "never filled in", "not measured", "another time", "damaged"])
def test_an_imu_that_cannot_be_used_is_left_aside_and_that_is_told(tmp_path: Path, why: str) -> None:
    recording = turning((0.0, 0.0, 0.5))
    if why == "no mount":
        recording = turning((0.0, 0.0, 0.5), None)
    if why == "moves":
        recording = turning((0.0, 0.0, 0.5), None)
        for i in range(3):
            link(recording, i * SECOND, "base", "imu_link", 0.0, 0.5 * i)
    if why == "never filled in":
        recording = turning((0.0, 0.0, 0.0))
    if why == "not measured":
        recording = turning((0.0, 0.0, 0.5), measured=False)
    if why == "another time":
        recording = Recording()
        recording.entries = [e for e in turning((0.0, 0.0, 0.5)).entries if "Imu" not in e[1]]
        for i in range(100):
            recording.imu(900 * SECOND + i * SECOND // 100, (0.0, 0.0, 0.5))
    if why == "damaged":
        recording.entries = [(*e[:4], e[4][:50]) if "Imu" in e[1] else e for e in recording.entries]
    log = read(recording, tmp_path)
    assert (len(log), log.turns) == (11, None)
    assert log.metadata["reader"]["imu_unused"]


def test_rates_that_are_none_are_left_out_and_counted(tmp_path: Path) -> None:
    recording = turning((0.0, 0.0, 0.5))
    for i, rate in enumerate([math.nan, math.inf, 1e256, -300.0]):
        recording.imu(SECOND // 2 + 1_000_000 * (i + 1), (0.0, 0.0, rate))
    log = read(recording, tmp_path)
    np.testing.assert_allclose(turns(log), 0.5 * log.times, atol=1e-9)
    assert log.metadata["reader"]["imu_left_out"] == "4"


def test_messages_in_any_order_and_twice() -> None:
    stamps = at(np.arange(0, 2, 0.01))
    rates = np.sin(stamps / 1e9)
    shuffled = np.random.default_rng(0).permutation(np.concatenate([np.arange(200), np.arange(50)]))
    wanted = at([0.3, 1.2, 1.9])
    expected = turns_at(wanted, gyroscope(stamps, rates))
    np.testing.assert_allclose(turns_at(wanted, gyroscope(stamps[shuffled], rates[shuffled])), expected)  # type: ignore[arg-type]
    np.testing.assert_allclose(np.diff(expected), np.cos([0.3, 1.2]) - np.cos([1.2, 1.9]), atol=2e-4)  # type: ignore[arg-type]


def test_nothing_looks_ahead() -> None:
    """What comes after a stamp changes nothing at it."""
    rng = np.random.default_rng(0)
    stamps, rates = at(np.arange(0, 6, 0.01)), rng.normal(0.02, 0.01, 600)
    rates[300:] += rng.uniform(-1, 1, 300)
    odometry = planar_poses(at(np.arange(0, 6, 0.05)), np.arange(120), np.zeros((120, 3)), "odom")
    wanted = at(np.arange(0.05, 6, 0.13))
    whole = turns_at(wanted, gyroscope(stamps, rates), odometry)
    assert whole is not None
    for i in range(2, len(wanted)):
        known = stamps <= wanted[i]
        moved = odometry.stamps <= wanted[i]
        until = planar_poses(odometry.stamps[moved], np.arange(moved.sum()), np.zeros((moved.sum(), 3)), "odom")
        cut = turns_at(wanted[: i + 1], gyroscope(stamps[known], rates[known]), until)
        np.testing.assert_array_equal(cut, whole[: i + 1])


def test_its_zero_is_learned_while_the_robot_stands_still() -> None:
    """3 s of rest, then a turn: without that the heading would be off by 0.1 rad in the end."""
    times = np.arange(0, 8, 0.01)
    turning_now = np.where(times > 3.0, 0.4, 0.0)
    noise = np.random.default_rng(0).normal(0.0, 0.005, len(times))
    measured = gyroscope(at(times), turning_now + 0.02 + noise)
    poses = np.zeros((len(times), 3))
    poses[:, 2] = np.cumsum(turning_now) * 0.01
    odometry = planar_poses(at(times), np.arange(len(times)), poses, "odom")
    wanted = at([3.0, 7.99])
    learned, as_it_is = turns_at(wanted, measured, odometry), turns_at(wanted, measured)
    assert np.diff(learned)[0] == pytest.approx(0.4 * 4.99, abs=0.01)  # type: ignore[arg-type]
    assert np.diff(as_it_is)[0] == pytest.approx(0.42 * 4.99, abs=0.01)  # type: ignore[arg-type]


def test_a_slow_turn_that_the_odometry_sees_is_no_zero() -> None:
    times = np.arange(0, 5, 0.01)
    poses = np.column_stack([0 * times, 0 * times, 0.03 * times])
    odometry = planar_poses(at(times), np.arange(len(times)), poses, "odom")
    turned = turns_at(at([0.0, 4.9]), gyroscope(at(times), np.full(500, 0.03)), odometry)
    assert np.diff(turned)[0] == pytest.approx(0.03 * 4.9, abs=1e-3)  # type: ignore[arg-type]


def test_scans_within_a_gap_have_no_heading() -> None:
    times = np.concatenate([np.arange(0, 2, 0.01), np.arange(3, 5, 0.01)])
    wanted = np.arange(0.1, 5, 0.2)
    turned = turns_at(at(wanted), gyroscope(at(times), np.full(len(times), 0.5)))
    assert turned is not None
    unknown = wanted[np.isnan(turned)]
    np.testing.assert_allclose(unknown, [2.5, 2.7, 2.9])
    steps = np.diff(turned)
    np.testing.assert_allclose(steps[np.isfinite(steps)], 0.1, atol=1e-9)


def test_a_gap_between_two_scans_shows_too() -> None:
    times = np.concatenate([np.arange(0, 2, 0.01), np.arange(2.6, 5, 0.01)])
    turned = turns_at(at([1.9, 2.7, 2.9, 3.1]), gyroscope(at(times), np.full(len(times), 0.5)))
    np.testing.assert_array_equal(np.isnan(turned), [False, True, False, False])  # type: ignore[arg-type]


def test_short_gaps_are_bridged_and_scans_before_the_first_message_have_no_heading() -> None:
    times = np.concatenate([np.arange(1, 2, 0.01), np.arange(2.4, 3, 0.01)])
    turned = turns_at(at([0.5, 1.0, 1.5, 2.2, 2.5]), gyroscope(at(times), np.full(len(times), 0.5)))
    np.testing.assert_allclose(np.diff(turned)[1:], [0.25, 0.35, 0.15], atol=1e-6)  # type: ignore[arg-type]
    assert np.isnan(turned[0])  # type: ignore[index]


def test_messages_that_are_all_too_far_apart_say_nothing() -> None:
    assert turns_at(at([0.1, 1.1, 2.1]), gyroscope(at([0.0, 1.0, 2.0]), [0.1, 0.1, 0.1])) is None
