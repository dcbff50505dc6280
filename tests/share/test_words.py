"""At every scan it is said in words what is the matter, and why."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.export.run import read_run
from pipeline.inspect import RecordedEvent
from pipeline.judgement.verdict import KINDS
from pipeline.recording.scenes import Ragged
from pipeline.share.words import matters


@pytest.fixture(scope="module")
def run(recorded: Path):
    return read_run(recorded)


def judged(run, kind, probability, **scenes):
    """The run with this verdict at all of its scans, and its scenes otherwise."""
    told = replace(run.told, verdicts=np.full(150, KINDS.index(kind)), probabilities=np.full(150, probability))
    return replace(run, told=told, scenes=replace(run.scenes, **scenes))


def test_it_is_found_somewhere_give_or_take_something(run):
    x, y, yaw = run.told.poses[100]
    said = matters(run)[100]
    assert said.startswith(f"The robot is at ({x:.1f}, {y:.1f}) m, give or take 50 cm, heading {np.degrees(yaw):.0f}°;")
    fits, apart = run.scenes.curves["explained"][100], np.hypot(*(run.told.poses[100] - run.scenes.truth[100])[:2])
    assert f"right with probability above 0.99. {100 * fits:.0f} % of the beams end where the map says." in said
    assert said.endswith(f"The truth is {apart:.2f} m from there.")
    assert "right with probability 0.93" in matters(judged(run, "found", 0.93))[100]


def test_it_is_lost_among_places_that_are_named(run):
    said = matters(run)[20]
    (ax, ay), (bx, by) = run.scenes.hypotheses[20][:, :2]
    assert f"any of 2 places: 60 % at ({ax:.1f}, {ay:.1f}) m; 40 % at ({bx:.1f}, {by:.1f}) m." in said
    many = [("30 %, carried off to 4, 5", "20 %", "10 %", "5 %", "5 %", "1 %")] * 150
    rows = Ragged(np.tile([[1.0, 2.0, 0.1, 0.1, 0.0]], (900, 1)), np.arange(0, 901, 6))
    lost, among = (
        matters(judged(run, kind, 0.4, labels=tuple(many), hypotheses=rows))[100] for kind in ("lost", "ambiguous")
    )
    assert "any of 6 places: 30 % at (1.0, 2.0) m, if it was carried off to 4, 5; 20 % at" in lost
    assert "and 3 more" in lost
    assert "and 1 more" in among
    assert "does not decide between them" in among


@pytest.mark.parametrize(
    ("spread", "explained", "words"),
    [(5.0, 0.9, "spread over 5.0 m"), (0.1, 0.3, "fits badly"), (0.1, 0.9, "is not enough to trust it")],
)
def test_why_it_is_lost_at_one_place(run, spread, explained, words):
    curves = {**run.scenes.curves, "spread": np.full(150, spread), "explained": np.full(150, explained)}
    said = matters(judged(run, "lost", 0.4, curves=curves, labels=((),) * 150))[100]
    assert words in said
    assert "right with probability 0.40" in said


def test_off_the_map_the_map_is_not_asked(run):
    said = matters(judged(run, "off the map", 0.95))[100]
    assert "where the map knows nothing; that is right with probability 0.95." in said
    assert "beams" not in said


def test_beams_that_miss_are_told_apart(run):
    def rows(count):
        return Ragged(np.zeros((150 * count, 2)), np.arange(0, 150 * count + 1, count))

    said = matters(judged(run, "found", 0.95, hits=rows(2), shorts=rows(4), longs=rows(4)))[100]
    assert "40 % end earlier, at something that the map lacks and 40 % go on where the map has a wall." in said


def test_it_is_said_since_when_and_what_happened_then(run):
    verdicts = np.array([KINDS.index("found")] * 70 + [KINDS.index("lost")] * 40 + [KINDS.index("ambiguous")] * 40)
    event = RecordedEvent(70, float(run.told.times[70]), "gap", "WARN", "15 s are missing. Believed: nothing.")
    told = replace(run.told, verdicts=verdicts, events=(event,))
    said = matters(replace(run, told=told))
    assert f"So since {run.told.times[70]:.1f} s: 15 s are missing." in said[75]
    assert f"So since {run.told.times[70]:.1f} s: 15 s are missing." in said[145]
    assert "So since" not in said[60]


def test_a_recording_without_verdicts_says_nothing(run):
    told = replace(run.told, verdicts=np.empty(0, np.int64), probabilities=np.empty(0))
    assert set(matters(replace(run, told=told))) == {""}
