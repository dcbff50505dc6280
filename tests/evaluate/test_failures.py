"""Faults in runs: what followed them, and failures on the way, whose rate, kinds and places are what was asked for."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from test_evaluate import make_log

from pipeline.config import Config, load_config
from pipeline.errors import MclError
from pipeline.evaluate import (
    FAULT_COLUMNS,
    Comparison,
    compare,
    evaluate,
    fault_table,
    plot,
    plot_recovery,
    variants,
    with_failures,
)
from pipeline.evaluate.aftermath import aftermaths
from pipeline.evaluate.failures import ELSEWHERE, FAILURES, SHIFTED, TURNED, draw_failures
from pipeline.logs import schema
from pipeline.logs.disturbed import disturbed
from pipeline.logs.faults import Fault, note, parse_fault
from pipeline.logs.messages import Log, Trajectory

SECOND = 1_000_000_000
LONG = 1200


def long_log(**changes) -> Log:
    """Half a metre a second round a ring of 20 m, five minutes, four scans a second."""
    angle = np.arange(LONG) * 0.125 / 20
    truth = np.stack([20 * np.cos(angle), 20 * np.sin(angle), np.mod(angle + 1.5 * np.pi, 2 * np.pi) - np.pi], 1)
    stamps = 1_700_000_000 * SECOND + np.arange(LONG, dtype=np.int64) * (SECOND // 4)
    return replace(
        make_log("long"),
        stamps=stamps,
        odometry=truth,
        ranges=np.ones((LONG, 3), np.float32),
        ground_truth=Trajectory(stamps, truth),
        **changes,
    )


def follows_the_wheels(log: Log, config: Config, *, seed: int, threads: int):
    """A robot that believes its odometry, whatever befalls it."""
    return SimpleNamespace(
        stamps=log.stamps,
        poses=log.odometry,
        hindsight=None,
        weights=np.ones(len(log)),
        probability=np.ones(len(log)),
        covariances=np.tile(np.eye(3), (len(log), 1, 1)),
        explained=np.ones(len(log)),
        events=(),
        seconds={"filter": 0.1},
        seed=seed,
    )


# --- what followed a fault ------------------------------------------------------------------------------------------


def followed(wrong: list[tuple[int, int]], *faults: str, unknown: tuple[int, int] = (0, 0)):
    times, truth = np.arange(100.0), np.zeros((100, 3))
    poses = np.zeros((100, 3))
    for begin, end in wrong:
        poses[begin:end, 0] = 0.6
    truth[slice(*unknown)] = np.nan
    return [(each.fault, each.at, each.time, each.scans) for each in
            aftermaths(times, poses, truth, [parse_fault(text) for text in faults])]  # fmt: skip


def test_the_robot_is_found_again_when_it_stays_right_for_ten_seconds() -> None:
    assert followed([], "turn:40.5:90") == [("turn:40.5:90", 40.5, 0.5, 1)]
    assert followed([(41, 47)], "turn:40.5:90") == [("turn:40.5:90", 40.5, 6.5, 7)]
    assert followed([(41, 43), (53, 54)], "turn:40.5:90")[0][2:] == (13.5, 14)  # right for 9 s: not enough
    assert followed([(41, 43), (54, 55)], "turn:40.5:90")[0][2:] == (2.5, 3)
    assert followed([(41, 91)], "turn:40.5:90")[0][2:] == (None, None)  # 9 s are left
    assert followed([(41, 90)], "turn:40.5:90")[0][2:] is not None


def test_a_gap_can_be_seen_when_it_is_over() -> None:
    assert followed([(60, 63)], "gap:40:60.5")[0][1:] == (60.5, 2.5, 3)


def test_before_the_next_fault_or_never() -> None:
    told = followed([(41, 45)], "turn:52.5:90", "slide:40.5:1:0")
    assert told == [("slide:40.5:1:0", 40.5, None, None), ("turn:52.5:90", 52.5, 0.5, 1)]
    assert followed([(41, 42)], "turn:40.5:90", "gap:53:60")[0][2:] == (1.5, 2)


def test_where_the_truth_is_unknown_nothing_is_right_or_wrong() -> None:
    assert followed([(41, 45)], "turn:40.5:90", unknown=(42, 48))[0][2:] == (7.5, 8)
    assert followed([(50, 52)], "turn:40.5:90", unknown=(50, 52))[0][2:] == (0.5, 1)


def test_a_fault_from_the_start_has_no_aftermath() -> None:
    assert followed([], "mirrored", "scale:0.7", "dead:0", "thin:2") == []


# --- faults in an evaluation ----------------------------------------------------------------------------------------


def test_every_seed_has_its_own_faults_and_the_truth_goes_with_the_scans() -> None:
    log = long_log()
    asked = [parse_fault("gap"), parse_fault("turn:299:90")]
    done = evaluate([log], [None], Config(), runs=6, jobs=1, faults=asked, runner=follows_the_wheels)
    (only,) = done.logs
    placed = [run.faults[0].placed for run in only.runs] + [run.faults[1].placed for run in only.runs]
    assert len(set(placed)) == 7
    for run in only.runs:
        assert len(run.times) == len(run.truth) == len(run.poses) < LONG
        np.testing.assert_allclose(run.poses[run.times < 199], run.truth[run.times < 199], atol=1e-6)
    rows = fault_table(done)
    assert [dict(zip(FAULT_COLUMNS, row, strict=True))["found again"] for row in rows] == ["100.0%", "0.0%"]
    assert [row[1:3] for row in rows] == [("gap", "6"), ("turn:299:90", "6")]
    plain = json.loads(json.dumps(done.to_dict()))["logs"]["long"]
    assert plain["faults"][1] == {
        "fault": "turn:299:90", "times": 6, "found_again": 0, "at_once": 0, "time": None,
    }  # fmt: skip
    assert {fault["fault"] for fault in plain["seeds"][0]["faults"]} == {"gap", "turn:299:90"}
    again = evaluate([log], [None], Config(), runs=6, jobs=2, faults=asked, runner=follows_the_wheels)
    assert [run.faults for run in again.logs[0].runs] == [run.faults for run in only.runs]


def test_a_carried_robot_is_searched_for_anew() -> None:
    asked = [parse_fault("carried:100:130")]
    done = evaluate([long_log()], [None], Config(), runs=1, jobs=1, faults=asked, runner=follows_the_wheels)
    (run,) = done.logs[0].runs
    assert [(r.kidnapped_at, r.recovered) for r in run.score.recoveries] == [(130.0, False)]
    assert not run.score.success
    assert run.faults[0].time is None


def test_what_a_log_notes_of_itself_is_judged() -> None:
    metadata = {schema.FAULTS: note([Fault("turn", (100.0, 90.0), "turn")])}
    log = long_log(metadata=metadata)
    done = evaluate([log], [None], Config(), runs=2, jobs=1, runner=follows_the_wheels)
    assert [row[1:4] for row in fault_table(done)] == [("turn:100:90", "2", "100.0%")]


def test_without_faults_nothing_is_told_of_them() -> None:
    done = evaluate([long_log()], [None], Config(), runs=1, jobs=1, runner=follows_the_wheels)
    assert fault_table(done) == []
    assert "fault" not in json.dumps(done.to_dict())


def test_wrong_faults_are_known_before_any_run() -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("a run was started")

    with pytest.raises(MclError, match=r"long\.mcap: fault turn:400:90: the log runs"):
        evaluate([long_log()], [None], Config(), runs=1, jobs=1, faults=[parse_fault("turn:400:90")], runner=never)
    carried = long_log(metadata={"source": {"kidnapped_at": "[100]"}})
    with pytest.raises(MclError, match=r"long\.mcap: failures are made in a log in which nobody was carried off"):
        evaluate([carried], [None], Config(), runs=1, jobs=1, failures=0.1, runner=never)


# --- failures on the way --------------------------------------------------------------------------------------------


def draws(rate: float, seeds: int = 150):
    log = long_log()
    return [draw_failures(log.times, log.odometry, rate, seed) for seed in range(seeds)]


def test_there_are_as_many_failures_as_the_rate_says() -> None:
    """Of the metres on which there may be one, at half a metre a second."""
    log = long_log()
    for rate in (0.01, 0.1):
        made, metres = 0, 0.0
        for faults in draws(rate):
            end = disturbed(log, faults)[0].duration - 15
            closed = np.array([0.0, *(fault.begin for fault in faults)])
            metres += 0.5 * (end - np.sum(np.minimum(end - closed, 15.0)))
            made += len(faults)
        assert made > 100
        assert made / metres == pytest.approx(rate, rel=0.15)


def test_the_three_kinds_are_as_frequent() -> None:
    names = [fault.name for faults in draws(0.03) for fault in faults]
    shares = [names.count(name) / len(names) for name in FAILURES]
    np.testing.assert_allclose(shares, 1 / 3, atol=0.06)


def test_failures_leave_time_to_recover() -> None:
    log = long_log()
    for faults in draws(0.2, 60):
        made, _ = disturbed(log, faults)
        at = np.array([0.0, *(fault.begin for fault in faults), made.times[-1]])
        assert np.diff(at).min() >= 14.99
        assert made.duration <= log.duration


def test_what_is_drawn_is_what_its_name_says() -> None:
    log = long_log()
    for faults in draws(0.1, 60):
        made, rows = disturbed(log, faults)
        truth = log.odometry[rows]
        for fault in faults:
            k = int(np.searchsorted(made.times, fault.begin))
            leap = np.hypot(*(truth[k, :2] - truth[k - 1, :2]))
            if fault.name == TURNED:
                assert fault.args[1] == 180.0
            elif fault.name == SHIFTED:
                assert 0.5 <= np.hypot(*fault.args[1:]) <= 3.0
            else:
                assert fault.name == ELSEWHERE
                assert fault.kind == "jump"
                assert leap > 1.8
                continue
            assert leap < 0.2


def test_a_seed_draws_the_same_and_another_one_others() -> None:
    log = long_log()
    one = draw_failures(log.times, log.odometry, 0.1, 4)
    assert one == draw_failures(log.times, log.odometry, 0.1, 4) != draw_failures(log.times, log.odometry, 0.1, 5)


def test_who_believes_the_wheels_is_lost_by_every_failure() -> None:
    done = evaluate([long_log()], [None], Config(), runs=12, jobs=1, failures=0.05, runner=follows_the_wheels)
    rows = {row[1]: row for row in fault_table(done)}
    assert set(rows) == {*FAILURES, "any failure"}
    made = int(rows["any failure"][2])
    assert made == sum(int(rows[name][2]) for name in FAILURES) > 30
    assert float(rows["any failure"][3].rstrip("%")) < 20
    assert done.to_dict()["failures"] == 0.05


def test_who_knows_the_truth_is_never_lost() -> None:
    log = long_log()

    def knows(given: Log, config: Config, *, seed: int, threads: int):
        _, rows = disturbed(log, draw_failures(log.times, log.odometry, 0.05, seed))
        return SimpleNamespace(
            stamps=given.stamps, poses=log.odometry[rows], hindsight=None, weights=np.ones(len(rows)),
            probability=np.ones(len(rows)), explained=np.ones(len(rows)),
            covariances=np.tile(np.eye(3), (len(rows), 1, 1)), events=(), seconds={},
        )  # fmt: skip

    done = evaluate([log], [None], Config(), runs=12, jobs=1, failures=0.05, runner=knows)
    assert {row[3] for row in fault_table(done)} == {"100.0%"}
    assert done.logs[0].successes == 12


def test_rates_are_compared_as_parameters_are(tmp_path) -> None:
    keys, found = variants(["recovery=search,augmented"], lambda values: load_config(None, values))
    keys, found = with_failures(keys, found, [0.02, 0.2])
    assert keys == ("failures per metre", "recovery")
    assert [one.label for one in found] == ["0.02, search", "0.02, augmented", "0.2, search", "0.2, augmented"]
    done = compare(
        [long_log()], [None], [one.config for one in found], 1, 1,
        failures=[one.failures for one in found], runner=follows_the_wheels,
    )  # fmt: skip
    comparison = Comparison(keys, found, done)
    assert [row[1] for row in comparison.fault_table() if row[2] == "any failure"] == [one.label for one in found]
    plain = json.loads(json.dumps(comparison.to_dict()))
    assert plain["variants"][2]["values"] == {"failures per metre": 0.2, "recovery": "search"}
    plot_recovery(comparison, tmp_path / "rates.png")
    with Image.open(tmp_path / "rates.png") as picture:
        assert picture.width > 1000
        assert len(picture.convert("L").getcolors(10**6)) > 20
    plot(comparison, tmp_path / "paths.png")
    assert (tmp_path / "paths.png").stat().st_size > 10_000


def test_one_rate_is_no_comparison_and_a_wrong_one_is_an_error() -> None:
    keys, found = with_failures(*variants([], lambda values: load_config(None, values)), [0.1])
    assert (keys, found[0].failures) == ((), 0.1)
    for rate in (0.0, -1.0, float("inf"), float("nan")):
        with pytest.raises(MclError, match="expected a number of failures per metre, more than 0"):
            with_failures(keys, found, [rate])
