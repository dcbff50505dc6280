"""Forecasters that know how much they know, and one that is too sure: the scores tell them apart."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from test_evaluate import make_log, stub

from pipeline.config import Config
from pipeline.evaluate import (
    REGION_COLUMNS,
    RELIABILITY_COLUMNS,
    SCORE_COLUMNS,
    Run,
    calibration,
    evaluate,
    plot_calibration,
    region_table,
    reliability_table,
    score_table,
)
from pipeline.evaluate.metrics import score

SIGMA = np.array([0.05, 0.03, 0.02])
TURNED = 0.4


def forecaster(seed: int, scans: int = 400, sharper: float = 1.0, narrower: float = 1.0) -> Run:
    """A run that is right as often as it states, and errs as its covariance says.

    ``sharper``: it states p^sharper / (p^sharper + (1 - p)^sharper) instead; ``narrower``: it divides its sigmas by so
    much. Where it is not right it is 10 m off. Its errors are correlated over x and y, and turned.
    """
    rng = np.random.default_rng([seed, 77])
    p = rng.beta(2.0, 1.0, scans)
    right = rng.random(scans) < p
    turn = np.array([[np.cos(TURNED), -np.sin(TURNED), 0.0], [np.sin(TURNED), np.cos(TURNED), 0.0], [0.0, 0.0, 1.0]])
    covariance = turn @ np.diag(SIGMA**2) @ turn.T
    truth = np.column_stack([rng.uniform(-50, 50, (scans, 2)), rng.uniform(-np.pi, np.pi, scans)])
    poses = truth + (rng.normal(size=(scans, 3)) * SIGMA) @ turn.T
    poses[~right, 0] += 10.0
    stated = p**sharper / (p**sharper + (1.0 - p) ** sharper)
    times = np.arange(scans, dtype=np.float64)
    return Run(
        seed, score(times, poses, truth), poses, {}, 1.0, times, truth, stated,
        np.tile(covariance / narrower**2, (scans, 1, 1)), np.ones(scans),
    )  # fmt: skip


def within(figure, value: float) -> bool:
    return figure.low <= value <= figure.high


def test_who_is_calibrated_is_told_so():
    told = calibration([forecaster(seed) for seed in range(30)])
    assert (told.runs, told.scans) == (30, 12_000)
    assert sum(each.scans for each in told.bins) == told.scans
    full = [each for each in told.bins if each.scans > 100]
    assert len(full) >= 10
    # 95 % intervals: of a dozen bins one may miss, two hardly.
    assert sum(within(each.right, each.stated) for each in full) >= len(full) - 1
    assert within(told.base_rate, 2 / 3)  # the mean of Beta(2, 1)
    assert within(told.brier, 1 / 6)  # the mean of p (1 - p)
    assert within(told.log_score, 1 / 2)  # the mean of the entropy of p, p of Beta(2, 1)
    assert told.brier.high < told.base_brier.low
    assert told.base_brier.value == pytest.approx(2 / 9, abs=0.005)
    assert told.base_log_score.value == pytest.approx(0.6365, abs=0.01)
    inside = [within(region.right, region.probability) for region in told.regions]
    assert sum(inside) >= 5
    assert within(told.nees, 1.0)


def test_who_is_too_sure_is_told_so():
    told = calibration([forecaster(seed, sharper=4.0, narrower=2.0) for seed in range(30)])
    high = next(each for each in told.bins if each.low == 0.9)
    assert high.right.high < high.low
    honest = calibration([forecaster(seed) for seed in range(30)])
    assert told.brier.low > honest.brier.high
    assert told.log_score.low > honest.log_score.high
    assert told.base_rate == honest.base_rate
    for region in told.regions:
        assert region.right.high < region.probability
    assert told.nees.value == pytest.approx(4.0, rel=0.05)


def test_where_it_is_elsewhere_the_truth_is_in_no_region():
    told = calibration([forecaster(seed) for seed in range(4)])
    rate = told.base_rate.value
    for region in told.regions[:3]:
        assert region.all.value == pytest.approx(rate * region.right.value)


def test_the_bootstrap_is_over_runs_and_its_seed_decides():
    """Runs that are each right throughout or wrong throughout: their scans are many, and the runs are few."""
    runs = []
    for seed in range(8):
        run = forecaster(seed)
        poses = run.truth + (0.0 if seed % 2 else 10.0)
        runs.append(replace(run, poses=poses))
    told = calibration(runs)
    assert told.base_rate.value == 0.5
    assert told.base_rate.high - told.base_rate.low > 0.5
    assert told == calibration(runs)
    assert told.brier != calibration(runs, seed=1).brier


def test_one_run_has_no_interval_and_empty_bins_no_figure():
    run = forecaster(0)
    sure = replace(run, poses=run.truth, probability=np.ones(400))
    told = calibration([sure])
    assert told.brier.low is None
    assert told.brier.value == pytest.approx(1e-6)
    assert told.log_score.value == pytest.approx(-np.log(0.999))
    assert [each.scans for each in told.bins][-2:] == [0, 400]  # 1 belongs to the last bin
    assert told.bins[0].right.value is None
    assert len(reliability_table("log", told)) == 1
    assert json.loads(json.dumps(told.to_dict(), allow_nan=False))["scans"] == 400


def test_scans_without_truth_are_left_out_and_no_covariance_is_too_small():
    run = forecaster(0)
    truth = run.truth.copy()
    truth[100:] = np.nan
    nothing = np.zeros_like(run.covariances)
    told = calibration([replace(run, truth=truth, covariances=nothing)])
    assert told.scans == 100
    assert told.nees.value is not None
    assert told.nees.value > 100


def test_an_evaluation_keeps_what_is_needed_and_tables_have_their_columns(tmp_path):
    logs = [make_log("a"), make_log("b")]
    done = evaluate(logs, [None, None], Config(), runs=3, jobs=1, runner=stub)
    for log in done.logs:
        for run in log.runs:
            np.testing.assert_array_equal(run.probability, np.linspace(0.0, 1.0, 60))
            assert run.covariances.shape == (60, 3, 3)
    told = calibration([run for log in done.logs for run in log.runs])
    assert (told.runs, told.scans) == (6, 360)
    assert {len(row) for row in reliability_table("all", told)} == {len(RELIABILITY_COLUMNS)}
    assert {len(row) for row in score_table("all", told)} == {len(SCORE_COLUMNS)}
    assert {len(row) for row in region_table("all", told)} == {len(REGION_COLUMNS)}
    plot_calibration([("a", told), ("b", told)], tmp_path / "reliability.png")
    with Image.open(tmp_path / "reliability.png") as picture:
        assert picture.width > 1000
        assert len(picture.convert("L").getcolors(10**6)) > 20
