"""Moments at which nobody saw how the robot moved."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pipeline.config import Config
from pipeline.logs.messages import Log
from pipeline.motion.gaps import Gaps
from pipeline.motion.laser_odometry import Match
from pipeline.motion.witnesses import Motion, Witnesses

DROVE, STOOD = np.array([3.0, 0.2, 0.1]), np.array([0.05, 0.0, 0.01])


def match(fit: float = 0.95, stretch: int = 0, wide: bool = False, pose: np.ndarray | None = None) -> Match:
    return Match(np.zeros(3) if pose is None else pose, np.eye(3), fit, fit, None, wide, stretch)


def after(interval: float, seconds: float, told: np.ndarray | None, now: Match):
    """What is found after thirty scans that are ``interval`` apart, and one so many seconds later."""
    gaps = Gaps()
    for _ in range(30):
        assert gaps.update(interval, STOOD, match(), match()) is None
    return gaps.update(seconds, told, match(), now)


@pytest.mark.parametrize(("interval", "seconds"), [(0.1, 1.5), (0.2, 2.4), (5.0, 20.0)])
def test_a_logger_that_pauses_makes_no_gap(interval: float, seconds: float) -> None:
    assert after(interval, seconds, DROVE, match(fit=0.6)) is None


def test_a_robot_that_sees_what_it_saw_before_has_not_been_away() -> None:
    gap = after(0.2, 30.0, STOOD, match(fit=0.95))
    assert gap is not None
    assert gap.bridged


@pytest.mark.parametrize(("told", "driven"), [(DROVE, True), (STOOD, False), (None, False)])
def test_whether_the_robot_drove_on_is_what_the_wheels_say(told: np.ndarray | None, driven: bool) -> None:
    gap = after(0.2, 18.0, told, match(fit=0.6))
    assert gap is not None
    assert (gap.kind, gap.seconds, gap.driven, gap.bridged) == ("missing", 18.0, driven, False)


@pytest.mark.parametrize("now", [match(stretch=1), match(fit=0.7, wide=True, pose=DROVE)])
def test_other_walls_from_one_scan_to_the_next(now: Match) -> None:
    gap = after(0.2, 0.2, DROVE * 0.05, now)
    assert gap is not None
    assert gap.kind == "unmatched"
    assert not gap.driven


@pytest.mark.parametrize(
    ("off", "agrees"),
    [((0.0, 0.0, 0.0), True), ((0.2, -0.2, 0.25), True), ((0.35, 0.0, 0.0), False), ((0.0, 0.0, -0.35), False)],
)
def test_a_poor_match_where_the_wheels_say_is_a_drive_to_what_is_new(off: tuple[float, ...], agrees: bool) -> None:
    """Also where the wheels' heading goes round."""
    for told in (DROVE, np.array([-1.0, 0.5, 3.1])):
        seen = told + off
        seen[2] = (seen[2] + np.pi) % (2 * np.pi) - np.pi
        gap = after(0.2, 0.2, told, match(fit=0.7, wide=True, pose=seen))
        assert (gap is None) is agrees


def test_a_good_match_is_believed_against_the_wheels() -> None:
    assert after(0.2, 0.2, DROVE, match(fit=0.9, wide=True)) is None


def test_a_scan_that_shows_no_walls_is_no_gap() -> None:
    assert after(0.2, 0.2, DROVE * 0.05, dataclasses.replace(match(stretch=1), blind=True)) is None


def test_without_wheels_a_laser_that_parts_is_no_news() -> None:
    """There it often does, and the prior allows for it."""
    assert after(0.2, 0.2, None, match(stretch=1)) is None


def test_scans_that_are_far_apart_may_see_other_walls() -> None:
    for told, driven in ((DROVE, True), (STOOD, False)):
        gap = after(5.0, 5.0, told, match(stretch=1))
        assert gap is not None
        assert (gap.kind, gap.driven) == ("sparse", driven)


def test_a_scan_that_is_a_little_late_tells_a_carrying_too() -> None:
    """Two logs one after the other: the second begins a second later, somewhere else."""
    for told, driven in ((DROVE, True), (STOOD, False)):
        gap = after(0.2, 1.2, told, match(stretch=1))
        assert gap is not None
        assert (gap.kind, gap.driven) == ("unmatched", driven)


def heard(log: Log) -> list[Motion]:
    witnesses = Witnesses(log.laser, Config())
    return [witnesses.update(scan) for scan in log.scans()]


def test_the_embedded_drive_has_none(office: Log) -> None:
    motions = heard(office)
    assert [motion for motion in motions if motion.gap is not None] == []
