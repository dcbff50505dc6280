"""Faults made on purpose: what each does to the odometry and the scans, and that it does nothing else."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import MclError
from pipeline.geometry import between, compose, wrap_angle
from pipeline.logs import schema
from pipeline.logs.disturbed import disturbed
from pipeline.logs.faults import KINDS, Fault, note, noted, parse_fault, placed, scanned, told
from pipeline.logs.messages import Laser, Log, Trajectory

SECOND = 1_000_000_000
N = 400
TIMES = 0.25 * np.arange(N)  # 99.75 s


def drive() -> np.ndarray:
    """A robot that drives curves, forwards and, every fourth stretch, backwards, and sometimes stands."""
    steps = np.zeros((N - 1, 3))
    speed = np.repeat([0.12, 0.2, 0.0, -0.1], 25)
    steps[:, 0] = np.resize(speed, N - 1)
    steps[:, 2] = np.where(steps[:, 0] != 0.0, 0.04 * np.sin(np.arange(N - 1) / 9), 0.0)
    steps[:, 1] = steps[:, 0] * np.sin(steps[:, 2] / 2)
    poses = [np.array([3.0, -2.0, 0.7])]
    for step in steps:
        poses.append(compose(poses[-1], step))
    return np.array(poses)


def make_log(**changes) -> Log:
    poses = drive()
    stamps = 1_700_000_000 * SECOND + (TIMES * SECOND).astype(np.int64)
    ranges = np.arange(N * 3, dtype=np.float32).reshape(N, 3)
    log = Log(
        name="made",
        path=Path("made.mcap"),
        sha256="0" * 64,
        laser=Laser((0.0, 0.0, 0.0), -1.0, 1.0, 3, 0.0, 1e6, time_increment=0.05),
        stamps=stamps,
        odometry=poses,
        ranges=ranges,
        ground_truth=Trajectory(stamps, poses),
        sweeps=np.vstack([0.4 * between(poses[:-1], poses[1:]), np.zeros(3)]),
        turns=np.unwrap(poses[:, 2]),
    )
    return replace(log, **changes)


def steps_of(poses: np.ndarray) -> np.ndarray:
    return between(poses[:-1], poses[1:])


def after(text: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Steps before and after the fault, and the poses after it."""
    poses = drive()
    (fault,) = placed([parse_fault(text)], TIMES[-1], 0)
    wrong = told(fault, TIMES, poses)
    return steps_of(poses), steps_of(wrong), wrong


@pytest.mark.parametrize("text", ["turn:40.1:90", "slide:40.1:1:0.5", "restart:40.1"])
def test_a_passing_fault_changes_one_step(text: str) -> None:
    before, steps, wrong = after(text)
    k = int(np.searchsorted(TIMES, 40.1)) - 1
    np.testing.assert_array_equal(wrong[: k + 1], drive()[: k + 1])
    others = np.arange(N - 1) != k
    np.testing.assert_allclose(wrap_angle(steps - before)[others], 0.0, atol=1e-9)
    assert np.abs(steps - before)[k].max() > 0.4


def test_a_false_turn_is_added_to_what_the_wheels_say() -> None:
    before, steps, _ = after("turn:40.1:-90")
    k = int(np.searchsorted(TIMES, 40.1)) - 1
    np.testing.assert_allclose(wrap_angle((steps - before)[k]), [0, 0, -np.pi / 2], atol=1e-9)


def test_a_slide_is_what_the_wheels_did_not_count() -> None:
    """The true step is the slide, seen from the robot, and then the step that was told."""
    before, steps, _ = after("slide:40.1:1.5:-0.5")
    k = int(np.searchsorted(TIMES, 40.1)) - 1
    np.testing.assert_allclose(compose([1.5, -0.5, 0.0], steps[k]), before[k], atol=1e-9)


def test_spinning_wheels_count_distance_that_nobody_drove() -> None:
    before, steps, _ = after("spin:40.1:42.1:0.7")
    assert np.sum((steps - before)[:, 0]) == pytest.approx(2.0 * 0.7)
    np.testing.assert_allclose((steps - before)[:, 1:], 0.0, atol=1e-9)
    changed = np.flatnonzero(np.abs(steps - before)[:, 0] > 1e-9)
    assert (TIMES[changed] > 39.8).all()
    assert (TIMES[changed] < 42.1).all()


def test_dead_wheels_stand_still_and_go_on_from_there() -> None:
    before, steps, wrong = after("dead:40:60")
    within = (TIMES[:-1] >= 40) & (TIMES[1:] <= 60)
    np.testing.assert_allclose(steps[within], 0.0, atol=1e-9)
    np.testing.assert_allclose(steps[~within], before[~within], atol=1e-9)
    _, steps, _ = after("dead:40")
    np.testing.assert_allclose(steps[TIMES[:-1] >= 40], 0.0, atol=1e-9)
    np.testing.assert_array_equal(wrong[TIMES <= 40], drive()[TIMES <= 40])


def test_mirrored_wheels_draw_the_way_in_a_mirror() -> None:
    _, _, wrong = after("mirrored")
    way = between(drive()[0], drive())
    np.testing.assert_allclose(
        between(wrong[0], wrong), np.column_stack([way[:, 0], -way[:, 1], wrap_angle(-way[:, 2])]), atol=1e-9
    )


def test_wheels_without_a_sign_tell_driving_backwards_as_forwards() -> None:
    before, steps, _ = after("no-reverse")
    backwards = before[:, 0] < 0
    assert backwards.sum() > 50
    np.testing.assert_allclose(steps[backwards], before[backwards] * [-1, -1, 1], atol=1e-9)
    np.testing.assert_allclose(steps[~backwards], before[~backwards], atol=1e-9)


def test_a_wrong_scale_is_of_metres_and_not_of_turns() -> None:
    before, steps, _ = after("scale:0.7")
    np.testing.assert_allclose(steps, before * [0.7, 0.7, 1.0], atol=1e-9)


def test_a_restarted_counter_begins_at_zero() -> None:
    _, _, wrong = after("restart:40.1")
    k = int(np.searchsorted(TIMES, 40.1))
    np.testing.assert_allclose(wrong[k], 0.0, atol=1e-12)
    np.testing.assert_allclose(wrap_angle(wrong[k:] - between(drive()[k], drive()[k:])), 0.0, atol=1e-9)


def test_late_odometry_is_that_of_before() -> None:
    _, _, wrong = after("late:0.5")
    np.testing.assert_allclose(wrong[2:, :2], drive()[:-2, :2], atol=1e-9)
    np.testing.assert_allclose(wrong[:2, :2], drive()[[0, 0], :2], atol=1e-9)


def test_in_a_gap_the_odometry_goes_on_and_a_carried_robots_does_not() -> None:
    log = make_log()
    for text, moved in (("gap:40:60", True), ("carried:40:60", False)):
        made, rows = disturbed(log, [parse_fault(text)])
        assert ((TIMES[rows] < 40) | (TIMES[rows] > 60)).all()
        assert len(rows) == N - 81  # both ends included
        k = int(np.searchsorted(made.times, 60))
        step = between(made.odometry[k - 1], made.odometry[k])
        true = between(log.odometry[rows[k - 1]], log.odometry[rows[k]])
        np.testing.assert_allclose(step, true if moved else 0.0, atol=1e-9)
        assert np.hypot(*true[:2]) > 1.0
        np.testing.assert_allclose(steps_of(made.odometry)[k:], steps_of(log.odometry[rows])[k:], atol=1e-9)


def test_a_thinned_log_has_a_scan_every_so_many_seconds() -> None:
    made, rows = disturbed(make_log(), [parse_fault("thin:5")])
    np.testing.assert_allclose(np.diff(made.times), 5.0)
    np.testing.assert_array_equal(rows, np.arange(0, N, 20))
    assert not scanned(parse_fault("thin:5"), np.array([0.0, 4.9, 5.1, 9.9, 10.2]))[[1, 3]].any()


ANYTHING = ["gap", "carried", "turn", "slide", "spin", "dead", "mirrored", "no-reverse", "scale:0.7", "restart",
            "late:0.3", "thin:5"]  # fmt: skip


@pytest.mark.parametrize("text", ANYTHING)
def test_the_truth_and_what_the_laser_saw_stay_exact(text: str) -> None:
    log = make_log()
    made, rows = disturbed(log, placed([parse_fault(text)], log.duration, 3))
    assert made.ground_truth is log.ground_truth
    assert made.grid is log.grid
    np.testing.assert_array_equal(made.ranges, log.ranges[rows])
    np.testing.assert_array_equal(made.stamps, log.stamps[rows])
    assert (np.abs(made.odometry[:, 2]) <= np.pi).all()
    assert len(made.sweeps) == len(made.turns) == len(made)


def test_every_kind_is_tested_and_is_in_the_help() -> None:
    from pipeline.cli.parameters import FaultOption

    assert {text.partition(":")[0] for text in ANYTHING} == set(KINDS) - {"jump"}
    told_in_help = FaultOption.__metadata__[0].help
    examples = [word.rstrip(",") for word in told_in_help.split() if word.rstrip(",").partition(":")[0] in KINDS]
    assert {parse_fault(text).kind for text in examples} == set(KINDS) - {"jump"}


@pytest.mark.parametrize("text", ANYTHING)
def test_chance_follows_from_the_seed(text: str) -> None:
    fault = parse_fault(text)
    assert placed([fault], 100.0, 5) == placed([fault], 100.0, 5)
    if KINDS[fault.kind].drawn is not None:
        assert len({placed([fault], 100.0, seed) for seed in range(20)}) == 20
        one, other = placed([fault, fault], 100.0, 5)
        assert one != other


def test_chance_keeps_within_its_bounds() -> None:
    asked = [parse_fault(text) for text in ("gap", "carried", "turn", "slide", "spin", "dead", "restart")]
    drawn = np.array([[fault.args[:3] + (0.0,) * (3 - len(fault.args)) for fault in placed(asked, 100.0, seed)]
                      for seed in range(500)])  # fmt: skip
    gap, carried, turn, slide, spin, dead, restart = np.moveaxis(drawn, 1, 0)
    for each in (gap, carried, turn, slide, spin, dead, restart):
        assert each[:, 0].min() >= 15
        assert each[:, 0].max() <= 85
        assert each[:, 0].max() > 65 if each is gap else True
    for each in (gap, carried):
        length = each[:, 1] - each[:, 0]
        assert 10 <= length.min() < 11 < 29 < length.max() <= 30.001
        assert each[:, 1].max() <= 85.001
    degrees = np.abs(turn[:, 1])
    assert 30 <= degrees.min() < 33 < 117 < degrees.max() <= 120
    assert 0.4 < (turn[:, 1] > 0).mean() < 0.6
    metres = np.hypot(slide[:, 1], slide[:, 2])
    assert 0.499 <= metres.min() < 0.55 < 2.9 < metres.max() <= 3.001
    assert np.abs(slide[:, 1:].mean(axis=0)).max() < 0.25
    np.testing.assert_allclose(spin[:, 1] - spin[:, 0], 2.0, atol=1e-6)
    assert np.isinf(dead[:, 1]).all()
    np.testing.assert_allclose(restart[:, 0].mean(), 50.0, atol=3.0)


def test_what_is_given_is_not_drawn() -> None:
    (gap,), (turn,) = (placed([parse_fault(text)], 100.0, 1) for text in ("gap:40", "turn:40"))
    assert gap.args[0] == turn.args[0] == 40.0
    assert 10.0 <= gap.args[1] - 40.0 <= 30.0
    assert placed([parse_fault("slide:40:2")], 100.0, 1)[0].args == (40.0, 2.0, 0.0)
    assert placed([parse_fault("spin:40:42")], 100.0, 1)[0].args == (40.0, 42.0, 0.5)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("truning:40:90", "no kind of fault 'truning'.*there are gap, carried, turn"),
        ("turn:forty:90", "'turn:forty:90' is not turn:AT:DEGREES in numbers; what is left out"),
        ("turn:40:90:3", "is not turn:AT:DEGREES"),
        ("turn:nan", "is not turn:AT:DEGREES"),
        ("scale", "'scale' is not scale:FACTOR in numbers$"),
        ("scale:0", "FACTOR must be more than 0"),
        ("late:-1", "SECONDS must be more than 0"),
        ("mirrored:1", "'mirrored:1' is not mirrored in numbers$"),
        ("gap:60:40", r"\(gap:FROM:TO\): TO must be later than FROM"),
        ("gap:0:40", "it must begin after the first scan"),
        ("turn:0:90", "it must begin after the first scan"),
        ("dead:-1", "FROM must not be less than 0"),
    ],
)
def test_what_asks_for_no_fault_is_an_error(text: str, said: str) -> None:
    with pytest.raises(MclError, match=said):
        parse_fault(text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("turn:100:90", r"fault turn:100:90: the log runs from 0 to 99\.8 s"),
        ("gap:90:120", "nothing is left after it"),
    ],
)
def test_what_lies_outside_of_the_log_is_an_error(text: str, said: str) -> None:
    with pytest.raises(MclError, match=said):
        placed([parse_fault(text)], TIMES[-1], 0)


def test_a_log_may_be_too_short_for_chance() -> None:
    with pytest.raises(MclError, match=r"a log of 20\.0 s leaves no place.*say when"):
        placed([parse_fault("turn")], 20.0, 0)


def test_what_has_no_wheels_has_no_faults_of_wheels() -> None:
    log = make_log(wheels=False, odometry=np.zeros((N, 3)), sweeps=None)
    with pytest.raises(MclError, match="fault turn:40:90: the log has no odometry"):
        disturbed(log, [parse_fault("turn:40:90")])
    made, _ = disturbed(log, [parse_fault("carried:40:60"), parse_fault("thin:1")])
    assert not made.odometry.any()
    assert len(made) < N / 3


def test_how_the_robot_moved_during_a_scan_is_told_by_the_same_wheels() -> None:
    log = make_log()
    for text, factor in (("mirrored", [1, -1, -1]), ("scale:0.5", [0.5, 0.5, 1]), ("dead:0", [0, 0, 0])):
        made, _ = disturbed(log, placed([parse_fault(text)], log.duration, 0))
        np.testing.assert_allclose(made.sweeps, log.sweeps * factor, atol=1e-12)
    made, _ = disturbed(log, [parse_fault("turn:40.1:90")])
    assert np.count_nonzero(np.abs(made.sweeps - log.sweeps).max(axis=1) > 0.1) <= 1


def test_after_a_gap_the_gyroscope_begins_anew() -> None:
    log = make_log()
    made, _ = disturbed(log, [parse_fault("gap:40:60")])
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(made.turns)), [np.searchsorted(made.times, 60)])
    assert not np.isnan(log.turns).any()


def test_several_faults_are_made_one_after_the_other() -> None:
    log = make_log()
    both = [parse_fault(text) for text in ("scale:0.5", "slide:40.1:1", "mirrored")]
    made, _ = disturbed(log, placed(both, log.duration, 0))
    poses = log.odometry
    for fault in placed(both, log.duration, 0):
        poses = told(fault, log.times, poses)
    np.testing.assert_allclose(wrap_angle(made.odometry - poses), 0.0, atol=1e-12)


def test_a_jump_goes_on_elsewhere_in_the_log_and_the_wheels_tell_nothing_of_it() -> None:
    log = make_log()
    made, rows = disturbed(log, [parse_fault("jump:40:10"), parse_fault("jump:70:80")])
    k, j = int(np.searchsorted(made.times, 40)), int(np.searchsorted(made.times, 70))
    np.testing.assert_array_equal(rows[:k], np.arange(k))
    np.testing.assert_array_equal(rows[k:j], np.arange(40, 40 + j - k))
    np.testing.assert_array_equal(rows[j:], np.arange(320, N))
    np.testing.assert_allclose(np.diff(made.times), 0.25)
    steps, true = steps_of(made.odometry), steps_of(log.odometry[rows])
    np.testing.assert_allclose(steps[[k - 1, j - 1]], 0.0, atol=1e-12)
    others = ~np.isin(np.arange(len(steps)), [k - 1, j - 1])
    np.testing.assert_allclose(steps[others], true[others], atol=1e-9)
    assert np.hypot(*true[[k - 1, j - 1], :2].T).min() > 0.5
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(made.turns)), [k, j])
    assert made.ground_truth is None
    assert json.loads(made.metadata[schema.FAULTS]["kidnapped_at"]) == [40.0, 70.0]


def test_a_log_notes_what_was_done_to_it() -> None:
    made, _ = disturbed(make_log(), placed([parse_fault("turn:40:90"), parse_fault("dead:50")], 99.0, 0))
    again, _ = disturbed(made, [parse_fault("carried:60:70")])
    assert [fault.text for fault in noted(again.metadata)] == ["turn:40:90", "dead:50", "carried:60:70"]
    assert noted({}) == ()
    assert "kidnapped_at" not in note([Fault("turn", (40.0, 90.0), "turn")])
