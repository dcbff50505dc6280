"""Who takes the belief's place, and how far ahead it has to be."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.config import Config
from pipeline.filter.belief import Belief
from pipeline.filter.recovery import BEATEN, MARGIN, OPEN, Recovery, Takeover
from pipeline.filter.sensor import Sensor
from pipeline.logs.messages import Log

PLACES = np.array([(3.5, 3.5, 0.25), (9.5, 3.5, 0.25), (15.5, 3.5, 0.25)])
"""In the grid frame: the belief's, and those of two rivals."""


class Contest:
    """A belief and two rivals whose accounts the test writes."""

    def __init__(self, log: Log, margin: float) -> None:
        config = Config(occupied_threshold=0.65, range_bias=0.0, max_particles=2000, min_particles=300)
        sensor = Sensor(log.grid, log.laser, config)
        self.belief, self.recovery = Belief(log.grid, config, sensor, 0), Recovery(log.grid, config, sensor, 0)
        self.belief.move(*_crowd(PLACES[0]), np.uint64(1))
        for place in PLACES[1:]:
            self.recovery.rivals.adopt(*_crowd(place), time=0.0, scan=0, margin=margin)
        self.recovery._evidence.admit(2)

    def decide(self, *leads: float) -> Takeover | None:
        """With so many nats by which each rival is ahead of the belief."""
        self.recovery._evidence._leads = np.array([0.0, *leads])
        return self.recovery._decide(self.belief, SimpleNamespace(time=1.0, index=3))

    @property
    def place(self) -> int:
        """Which of PLACES the belief is at."""
        x = float(np.median(self.belief.particles.poses[0]))
        return int(np.argmin(np.abs(PLACES[:, 0] - x)))


def _crowd(place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    poses = np.random.default_rng(0).normal(place, 0.02, (300, 3)).T
    return np.ascontiguousarray(poses, np.float32), np.full(300, 1 / 300)


@pytest.mark.parametrize("margin", [MARGIN, OPEN])
def test_the_lead_over_the_belief_and_over_the_next_add_up(office: Log, margin: float) -> None:
    assert Contest(office, margin).decide(0.5 * margin - 0.1, -2.0) is None
    assert Contest(office, margin).decide(0.7 * margin, 0.5 * margin) is None, "two that are level"
    contest = Contest(office, margin)
    verdict = contest.decide(0.5 * margin + 0.1, -2.0)
    assert verdict is not None
    assert verdict.lead == pytest.approx(0.5 * margin + 0.1)
    assert contest.place == 1


def test_who_lost_narrowly_may_come_back_soon(office: Log) -> None:
    """No place has earned anything against those that it met in the same contest."""
    contest = Contest(office, MARGIN)
    assert contest.decide(MARGIN - 0.5, MARGIN - 1.0) is not None
    assert contest.place == 1
    np.testing.assert_array_equal(contest.recovery.rivals.margin, OPEN)
    # Rows now: the belief at place 1, place 2, and the place where the belief was.
    assert contest.decide(0.5 * OPEN + 0.1, -3.0) is not None
    assert contest.place == 2


def test_who_has_been_beaten_is_as_unlikely_as_any_other(office: Log) -> None:
    contest = Contest(office, OPEN)
    assert contest.decide(-BEATEN - 0.1, -1.0) is None
    assert contest.decide(0.5 * MARGIN - 0.1, -1.0) is None, "once far behind, it needs the whole margin"
    assert contest.decide(-1.0, 0.5 * OPEN + 0.1) is not None


def test_odds_follow_the_margin(office: Log) -> None:
    """About to take the belief's place, a lone rival is as likely as the belief."""
    for margin in (MARGIN, OPEN):
        contest = Contest(office, margin)
        contest.recovery._evidence._leads = np.array([0.0, 0.5 * margin, -50.0])
        np.testing.assert_allclose(contest.recovery.odds(), [0.5, 0.5, 0.0], atol=1e-6)
