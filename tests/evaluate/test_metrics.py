"""The formulas, on trajectories small enough to work out by hand."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import MclError
from pipeline.evaluate.metrics import (
    Summary,
    found_at,
    interpolate,
    is_localized,
    laser_to_base,
    pose_errors,
    rmse,
    score,
    wilson_interval,
)
from pipeline.geometry import compose
from pipeline.logs.messages import Trajectory

SECOND = 1_000_000_000


def trajectory(*rows: tuple[float, float, float, float]) -> Trajectory:
    table = np.array(rows, dtype=np.float64)
    return Trajectory((table[:, 0] * SECOND).astype(np.int64), table[:, 1:])


def run(errors: list[float], **options):
    """Score a robot that stands still while the estimate is off by so many metres along x, a scan a second."""
    poses = np.zeros((len(errors), 3))
    poses[:, 0] = errors
    return score(np.arange(len(errors), dtype=np.float64), poses, np.zeros_like(poses), **options)


# --- the reference


def test_the_reference_is_interpolated_in_position_and_along_the_shortest_angle():
    reference = trajectory((0, 0, 0, 3.0), (2, 4, -2, -3.0))
    poses = interpolate(reference, np.array([SECOND // 2, SECOND], dtype=np.int64))
    turn = 2 * np.pi - 6.0
    np.testing.assert_allclose(poses[0], [1, -0.5, 3.0 + turn / 4])
    np.testing.assert_allclose(poses[1, :2], [2, -1])
    assert abs(poses[1, 2]) == pytest.approx(np.pi)


def test_scans_outside_the_reference_have_no_truth_and_its_first_and_last_pose_count():
    reference = trajectory((1, 1, 0, 0), (2, 2, 0, 0))
    poses = interpolate(reference, np.array([SECOND - 1, SECOND, 2 * SECOND, 2 * SECOND + 1], dtype=np.int64))
    np.testing.assert_array_equal(np.isnan(poses[:, 0]), [True, False, False, True])
    np.testing.assert_array_equal(poses[1:3, 0], [1, 2])


def test_nanoseconds_of_our_century_keep_their_precision():
    start = 1_700_000_000 * SECOND
    reference = Trajectory(np.array([start, start + 10], dtype=np.int64), np.array([[0.0, 0, 0], [10, 0, 0]]))
    stamps = start + np.arange(11, dtype=np.int64)
    np.testing.assert_allclose(interpolate(reference, stamps)[:, 0], np.arange(11), atol=1e-12)


def test_an_empty_reference_says_nothing():
    empty = Trajectory(np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    assert np.isnan(interpolate(empty, np.array([5], dtype=np.int64))).all()


def test_a_laser_reference_becomes_one_of_base_link():
    laser = (0.25, 0.1, 0.3)
    base = np.array([[3.0, -2.0, 3.0], [0.0, 1.0, -1.0]])
    reference = Trajectory(np.array([0, 1], dtype=np.int64), compose(base, laser))
    np.testing.assert_allclose(laser_to_base(reference, laser).poses, base, atol=1e-12)


# --- errors


def test_heading_errors_are_measured_round_the_circle():
    poses = np.array([[0, 0, np.pi - 0.01], [3, 4, 0]])
    position, heading = pose_errors(poses, np.array([[0, 0, -np.pi + 0.01], [0, 0, -np.pi / 2]]))
    np.testing.assert_allclose(position, [0, 5])
    np.testing.assert_allclose(heading, [0.02, np.pi / 2], atol=1e-12)


def test_localized_needs_both_position_and_heading_and_includes_its_limits():
    position, heading = np.array([0.5, 0.51, 0.0, np.nan]), np.radians([10.0, 0.0, 10.1, 0.0])
    np.testing.assert_array_equal(is_localized(position, heading), [True, False, False, False])


def test_rmse_and_summary():
    assert rmse(np.array([3.0, 4.0])) == pytest.approx(np.sqrt(12.5))
    assert rmse(np.zeros(0)) is None
    assert Summary.of([]) is None
    assert Summary.of([0.0, 1.0, 2.0, 3.0, 4.0]) == Summary(2.0, pytest.approx(3.8), pytest.approx(np.sqrt(6.0)))


@pytest.mark.parametrize(
    ("localized", "expected"),
    [
        ("", None),
        ("....", None),
        ("####", 0),
        ("...#", 3),
        ("###.", None),  # 3 of 4 is under 95 %, and the last scan alone is not localized
        (".###################", 1),
        ("#.##################", 0),  # 19 of 20 is 95 %
        ("#..#################", 3),
        ("###################.", 0),  # what happens at the end is judged separately
    ],
)
def test_found_at_the_earliest_localized_scan_with_95_percent_localized_from_there(localized, expected):
    assert found_at(np.array([c == "#" for c in localized], dtype=np.bool_)) == expected


@given(st.lists(st.booleans(), max_size=60))
def test_found_at_agrees_with_its_definition(localized):
    matches = [i for i, good in enumerate(localized) if good and 20 * sum(localized[i:]) >= 19 * len(localized[i:])]
    assert found_at(np.array(localized, dtype=np.bool_)) == (matches[0] if matches else None)


def test_wilsons_interval():
    assert wilson_interval(10, 20) == (pytest.approx(0.29930, abs=1e-5), pytest.approx(0.70070, abs=1e-5))
    assert wilson_interval(100, 100) == (pytest.approx(0.96301, abs=1e-5), 1.0)
    assert wilson_interval(0, 100) == (0.0, pytest.approx(0.03699, abs=1e-5))
    assert wilson_interval(0, 3)[0] == 0.0
    assert wilson_interval(0, 0) == (0.0, 1.0)


# --- the score of a run


def test_a_run_that_finds_itself():
    result = run([8, 8, 0.3, 0.4, 0.3])
    assert result.success
    assert result.time_to_localize == 2.0
    assert (result.localized, result.localized_after) == (pytest.approx(0.6), 1.0)
    assert result.scans_right == result.to_dict()["scans_right"] == pytest.approx(0.6)
    assert result.position_error == Summary(
        pytest.approx(0.3), pytest.approx(0.39), pytest.approx(np.sqrt((0.09 + 0.16 + 0.09) / 3))
    )
    assert result.ate == pytest.approx(np.sqrt((128 + 0.34) / 5))
    assert result.ate_after == pytest.approx(np.sqrt(0.34 / 3))
    assert (result.end_position_error, result.end_heading_error) == (pytest.approx(0.3), 0.0)


def test_when_the_belief_is_certain_of_the_true_place():
    """The first scan that is right and has 90 % of the belief: neither alone will do."""
    assert run([8, 8, 0.3, 0.4, 0.3], weights=np.array([0.95, 0.5, 0.89, 0.9, 0.2])).certain_at == 3.0
    assert run([8, 8, 0.3, 0.4, 0.3], weights=np.full(5, 0.5)).certain_at is None
    assert run([8, 8, 0.3, 0.4, 0.3]).certain_at is None


def test_a_run_that_is_never_localized():
    result = run([2, 2, 0.6])
    assert not result.success
    assert result.time_to_localize is result.localized_after is result.position_error is result.ate_after is None
    assert result.ate == pytest.approx(np.sqrt(8.36 / 3))
    json.dumps(result.to_dict(), allow_nan=False)


def test_a_run_that_is_localized_at_the_last_scan_only():
    result = run([9, 9, 9, 0.1])
    assert result.success
    assert result.time_to_localize == 3.0


def test_a_run_that_is_lost_at_the_last_scan_fails_though_it_was_found():
    result = run([0.0] * 39 + [1.5])
    assert not result.success
    assert result.time_to_localize == 0.0
    assert result.localized_after == pytest.approx(39 / 40)


def test_a_run_may_end_slightly_off_within_1_metre():
    assert run([0.0] * 39 + [0.9]).success


def test_a_wrong_heading_fails_a_run_and_counts_in_degrees():
    poses = np.zeros((40, 3))
    poses[-1, 2] = np.radians(-21)
    result = score(np.arange(40.0), poses, np.zeros((40, 3)))
    assert not result.success
    assert result.end_heading_error == pytest.approx(21)
    assert result.heading_error is not None
    assert result.heading_error.rmse == pytest.approx(21 / np.sqrt(40))


def test_scans_without_truth_are_not_scored_but_the_clock_runs_from_the_first_scan():
    truth = np.full((6, 3), np.nan)
    truth[2:5] = 0.0
    poses = np.zeros((6, 3))
    poses[[0, 1, 5], 0] = 99.0
    result = score(np.arange(6.0), poses, truth)
    assert result.success
    assert (result.scored, result.time_to_localize, result.ate) == (3, 2.0, 0.0)


def test_a_reference_that_covers_no_scan_is_an_error():
    with pytest.raises(MclError, match="covers none of the scans"):
        score(np.arange(3.0), np.zeros((3, 3)), np.full((3, 3), np.nan))


def test_false_alarms_are_lost_events_while_localized():
    assert run([5, 5, 0, 0, 0], lost_at=[1, 3, 4]).false_alarms == 2
    assert run([5, 5, 0, 0, 0], lost_at=[2]).false_alarms == 0, "the verdict that found it"
    assert run([5, 5, 0, 0, 0]).false_alarms == 0


def test_no_alarm_is_false_at_the_first_scan_of_a_robot_that_was_carried_off():
    at = 3.0
    assert run([0, 0, 0, 0, 0, 0], lost_at=[3]).false_alarms == 1
    assert run([0, 0, 0, 0, 0, 0], lost_at=[3], kidnapped_at=[at]).false_alarms == 0
    assert run([0, 0, 0, 0, 0, 0], lost_at=[4], kidnapped_at=[at]).false_alarms == 1


def test_hindsight_is_judged_at_the_first_scored_scan():
    truth = np.zeros((3, 3))
    truth[0] = np.nan
    hindsight = np.array([[9, 9, 0], [0.3, 0.4, np.radians(5)], [0, 0, 0]])
    result = score(np.arange(3.0), np.zeros((3, 3)), truth, hindsight=hindsight)
    assert result.hindsight_start_position_error == pytest.approx(0.5)
    assert result.hindsight_start_heading_error == pytest.approx(5)
    assert result.hindsight_ate == pytest.approx(np.sqrt(0.125))
    assert run([0, 0]).hindsight_ate is None


# --- kidnappings


def test_every_stretch_between_kidnappings_is_judged_by_itself():
    result = run([5, 0, 0, 0, 8, 8, 0, 0, 8, 8, 8], kidnapped_at=[7.5, 3.5])
    assert [(r.kidnapped_at, r.time) for r in result.recoveries] == [(3.5, 2.5), (7.5, None)]
    assert [r.recovered for r in result.recoveries] == [True, False]
    assert result.time_to_localize == 1.0
    assert not result.success
    assert result.localized_after == 1.0


def test_a_run_that_recovers_from_every_kidnapping_succeeds():
    assert run([5, 0, 0, 8, 0, 0], kidnapped_at=[2.5]).success


def test_a_scan_at_the_very_moment_belongs_to_the_stretch_that_begins():
    assert run([0, 0, 8, 0, 0], kidnapped_at=[2.0]).recoveries[0].time == 1.0


@pytest.mark.parametrize("at", [0.0, -1.0, 99.0])
def test_a_kidnapping_outside_the_log_is_an_error(at):
    with pytest.raises(MclError, match="the log runs from 0 to 4 s"):
        run([0, 0, 0, 0, 0], kidnapped_at=[at])


def test_a_stretch_that_the_reference_does_not_cover_is_an_error():
    truth = np.zeros((4, 3))
    truth[2:] = np.nan
    with pytest.raises(MclError, match=r"from 1\.5 s"):
        score(np.arange(4.0), np.zeros((4, 3)), truth, kidnapped_at=[1.5])
