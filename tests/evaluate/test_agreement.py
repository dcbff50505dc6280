"""What seeds tell of themselves where nobody knows the truth, and what is still refused then."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from test_evaluate import SCANS, make_log, stub

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.evaluate import AGREEMENT_COLUMNS, agreement_table, evaluate, parse_changes, plot, table
from pipeline.evaluate.agreement import agreement, middles
from pipeline.logs.faults import parse_fault


def unknown(**changes):
    return make_log(ground_truth=None, **changes)


def test_the_middle_is_where_most_are():
    poses = np.zeros((4, 3, 3))
    poses[3] += [10.0, 0.0, 0.0]  # one elsewhere at every scan
    poses[:3, 1, 0] = [0.0, 0.4, 0.8]  # a chain: only the middle one is near both others
    poses[1, 2, 2] = np.radians(11.0)  # turned too far
    middle, near = middles(poses)
    np.testing.assert_array_equal(middle[:, 0], [0.0, 0.4, 0.0])
    np.testing.assert_array_equal(near.T, [[1, 1, 1, 0], [1, 1, 1, 0], [1, 0, 1, 0]])


def test_headings_are_compared_on_the_circle():
    poses = np.array([[[0.0, 0.0, np.pi - 0.01]], [[0.0, 0.0, -np.pi + 0.01]]])
    assert middles(poses)[1].all()


def test_shares_are_means_over_scans_and_over_the_second_half():
    (log,) = evaluate([unknown()], [None], Config(), runs=4, jobs=1, runner=stub).logs
    # Seeds 0, 1, 2 are found after 5, 10, 15 scans, seed 3 never is: until then they are 10 m off, together.
    assert not log.scored
    told = log.agreement
    late = np.arange(SCANS) >= (SCANS - 1) / 2
    others = np.select([np.arange(SCANS) < n for n in (5, 10, 15)], [3, 2, 1], 2) / 3
    assert told.all.together == pytest.approx(others.mean())
    assert told.late.together == pytest.approx(others[late].mean()) == pytest.approx(2 / 3)
    stated = np.linspace(0.0, 1.0, SCANS)
    assert told.all.stated == pytest.approx(stated.mean())
    assert told.late.stated == pytest.approx(stated[late].mean())
    assert told.all.found == pytest.approx(np.mean(stated >= 0.9))
    assert told.all.explained == 0.0
    assert json.loads(json.dumps(log.to_dict(), allow_nan=False))["agreement"]["late"]["together"] == pytest.approx(
        2 / 3
    )


def test_the_truth_changes_nothing_of_it():
    known, not_known = (
        evaluate([log], [None], Config(), runs=3, jobs=1, runner=stub).logs[0] for log in (make_log(), unknown())
    )
    assert known.agreement.to_dict() == not_known.agreement.to_dict()
    assert known.scored


def test_a_single_run_agrees_with_nobody():
    evaluation = evaluate([unknown()], [None], Config(), runs=1, jobs=1, runner=stub)
    assert evaluation.logs[0].agreement.all.together is None
    (row,) = agreement_table(evaluation)
    assert row[:4] == ("ring", "1", "-", "-")


def test_each_log_has_its_row_in_one_table():
    evaluation = evaluate([make_log("a"), unknown(name="b")], [None, None], Config(), runs=2, jobs=1, runner=stub)
    assert [row[0] for row in table(evaluation)] == ["a"]
    (row,) = agreement_table(evaluation)
    assert len(row) == len(AGREEMENT_COLUMNS)
    assert row[0] == "b"
    assert evaluation.to_dict()["logs"]["b"]["successes"] is None


def test_runs_with_faults_of_their_own_are_not_compared():
    fault = parse_fault("turn:30:180")
    (log,) = evaluate([make_log()], [None], Config(), runs=2, jobs=1, runner=stub, faults=[fault]).logs
    assert log.agreement is None
    assert "agreement" not in log.to_dict()


@pytest.mark.parametrize("asked", [{"failures": 0.1}, {"change": parse_changes("0.1")[0]}])
def test_what_is_judged_by_the_truth_is_refused(asked):
    with pytest.raises(MclError, match=r"ring\.mcap: what is made wrong on purpose.*does not know \(give --reference"):
        evaluate([unknown()], [None], Config(), runs=1, jobs=1, runner=stub, **asked)


def test_the_picture_shows_who_ends_elsewhere(tmp_path):
    evaluation = evaluate([unknown()], [None], Config(), runs=4, jobs=1, runner=stub)
    plot(evaluation, tmp_path / "seeds.png")
    colours = np.asarray(Image.open(tmp_path / "seeds.png").convert("RGB")).reshape(-1, 3)
    for colour in ((0, 114, 178), (213, 94, 0)):  # those that end with the most, and the one that does not
        assert np.any(np.abs(colours.astype(int) - colour).sum(axis=1) < 12)


def test_of_runs_that_differ_the_first_of_the_most_central_is_taken():
    log = evaluate([unknown()], [None], Config(), runs=2, jobs=1, runner=stub).logs[0]
    apart = replace(log.runs[1], poses=log.runs[0].poses + np.array([50.0, 0.0, 0.0]))
    told = agreement((log.runs[0], apart))
    assert told.all.together == 0.0
    np.testing.assert_array_equal(told.middle, log.runs[0].poses)
