"""The sentence about wheels and laser that contradicted each other."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.filter.contradiction import Contradiction
from pipeline.geometry import compose
from pipeline.motion.laser_odometry import Match
from pipeline.motion.models import Component
from pipeline.motion.prior import AGREE, Prior
from pipeline.motion.witnesses import Motion


def told(forwards, wheels=(-0.1, 0.0, 0.0), laser=(0.1, 0.0, 0.0), follows=0.9, breaks=()):
    """Sentences of 40 scans, one each 0.2 s; the wheels are wrong in those between the two of ``forwards``."""
    story, sentences = Contradiction(), []
    by_wheels, by_laser, stretch = np.zeros(3), np.zeros(3), 0
    for k in range(40):
        wrong = forwards[0] <= k < forwards[1]
        by_wheels, by_laser = compose(by_wheels, wheels if wrong else laser), compose(by_laser, laser)
        stretch += k in breaks
        match = Match(by_laser, np.eye(3), 0.9, 0.9, None, False, stretch)
        parts = tuple(Component(name, np.zeros(3), np.eye(3), 0.5) for name in ("laser", "wheels"))
        step = SimpleNamespace(
            time=0.2 * k,
            motion=Motion(0.2 * k, by_wheels, match, None, by_laser, np.empty(0, np.float32)),
            moved=True,
            prior=Prior(parts, 2.0 * AGREE if wrong else 0.1) if k else None,
            followed=np.array([follows, 1.0 - follows]) if k else None,
        )
        sentences += story.hear(step)
    return [event.text for event in sentences]


def test_it_says_what_either_said_and_who_was_believed():
    assert told((10, 18)) == [
        "From 1.8 to 3.4 s the wheels say 0.8 m backwards, the laser 0.8 m forwards; "
        "90 % of the belief follows the laser."
    ]
    (turned,) = told((10, 18), wheels=(0.1, 0.0, 0.1), follows=0.2)
    assert "the wheels say 0.8 m forwards and 46 deg left, the laser 0.8 m forwards" in turned
    assert "80 % of the belief follows the wheels" in turned


@pytest.mark.parametrize(
    "what",
    [
        {"forwards": (10, 10)},
        {"forwards": (10, 14)},  # short
        {"forwards": (10, 18), "wheels": (0.08, 0.0, 0.0)},  # not far
        {"forwards": (10, 39)},  # not over
    ],
)
def test_it_says_nothing_of_little(what):
    assert told(**what) == []


def test_a_break_of_the_lasers_odometry_ends_it():
    (sentence,) = told((10, 22), breaks=(19,))
    assert sentence.startswith("From 1.8 to 3.6 s")


def test_no_word_without_wheels_or_laser():
    story = Contradiction()
    step = SimpleNamespace(
        time=0.0,
        motion=Motion(0.0, None, None, None, np.zeros(3), np.empty(0, np.float32)),
        moved=True,
        prior=None,
        followed=None,
    )
    assert story.hear(step) == []
