"""Lines are missing in a log: the robot drove on meanwhile, or somebody carried it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pipeline.config import Config
from pipeline.geometry import between, compose, wrap_angle
from pipeline.localization import RunResult, localize
from pipeline.logs.messages import Log

FROM, UPTO = 180, 270
"""Scans that are missing: about 18 s, in which the robot goes into another room."""


def cut(log: Log, *, carried: bool) -> Log:
    """Without these scans; ``carried``: the wheels stood still meanwhile, too."""
    keep, odometry = np.r_[:FROM, UPTO : len(log)], log.odometry.copy()
    if carried:
        odometry[UPTO:] = compose(odometry[FROM - 1], between(odometry[UPTO], odometry[UPTO:]))
    assert log.ground_truth is not None
    truth = dataclasses.replace(
        log.ground_truth, stamps=log.ground_truth.stamps[keep], poses=log.ground_truth.poses[keep]
    )
    return dataclasses.replace(
        log,
        stamps=log.stamps[keep],
        odometry=odometry[keep],
        ranges=log.ranges[keep],
        sweeps=None,
        ground_truth=truth,
    )


def right(log: Log, result: RunResult) -> np.ndarray:
    """(scans,) bool."""
    apart = result.poses - log.ground_truth.poses
    return (np.hypot(*apart[:, :2].T) < 0.5) & (np.abs(wrap_angle(apart[:, 2])) < np.radians(10.0))


def events(result: RunResult, kind: str) -> list[str]:
    return [event.text for _, _, event in result.events if event.kind == kind]


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("carried", [True, False])
def test_the_robot_is_found_again_at_once(office: Log, carried: bool, seed: int) -> None:
    log = cut(office, carried=carried)
    result = localize(log, Config(), seed=seed)
    after = right(log, result)[FROM:]
    assert after[15:].all(), "three seconds later at the latest"
    if not carried:
        assert after[2:].all()
        assert events(result, "lost") == []
    (gap,) = events(result, "gap")
    assert "s are missing before" in gap
    assert ("may have been carried" in gap) == carried
    assert ("so the robot drove on" in gap) == (not carried)
    if carried:
        assert len(events(result, "lost")) == 1
        assert ": it was carried off to " in events(result, "found")[0]
    else:
        assert "% that it drove on as the wheels say" in gap


def test_a_counter_that_is_restarted_costs_nothing_and_is_named(office: Log) -> None:
    odometry = office.odometry.copy()
    odometry[200:] = compose((60.0, 3.0, 2.0), between(odometry[200], odometry[200:]))
    log = dataclasses.replace(office, odometry=odometry)
    result = localize(log, Config(), seed=1)
    assert right(log, result)[30:].all()
    (leap,) = events(result, "slipped")
    assert f"at {office.times[200]:.1f} s" in leap
    assert events(result, "lost") == []


def test_a_grid_that_hears_of_a_carrying_may_be_anywhere(office: Log) -> None:
    log = cut(office, carried=True)
    begin, end = FROM - 20, FROM + 30
    truth = log.ground_truth
    near = dataclasses.replace(
        log,
        stamps=log.stamps[begin:end],
        odometry=log.odometry[begin:end],
        ranges=log.ranges[begin:end],
        ground_truth=dataclasses.replace(truth, stamps=truth.stamps[begin:end], poses=truth.poses[begin:end]),
    )
    start = tuple(truth.poses[begin].tolist())
    result = localize(near, Config(filter="grid", grid_d=0.2, grid_a=0.07, init="pose", initial_pose=start), seed=1)
    found = right(near, result)
    assert found[:20].all()
    assert found[30:].all()
