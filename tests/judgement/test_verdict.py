"""The verdict on every scan: what a place explains, against its rivals, and for how long it has not proved right."""

from __future__ import annotations

import dataclasses

import pytest

from pipeline.judgement.verdict import FORGOTTEN, KINDS, SETTLED, SURE, Judge, Signs, Verdict
from pipeline.logs.result import LEVELS

GOOD_PLACE = Signs(time=0.0, weight=0.98, worth=2.0, off=0.0, places=(0.98,), moved=False)


def judged(judge: Judge, seconds: float, since: float = 0.0, **signs: object) -> list[Verdict]:
    """The verdicts on scans five times a second, from ``since`` on, all with these signs."""
    n = round(5 * seconds)
    scans = [dataclasses.replace(GOOD_PLACE, time=since + 0.2 * k, **signs) for k in range(n)]  # type: ignore[arg-type]
    return [judge.judge(scan) for scan in scans]


def test_a_place_that_explains_the_scans_and_has_no_rival_is_found() -> None:
    verdicts = judged(Judge(), 30.0)
    assert {verdict.kind for verdict in verdicts[round(5 * (SETTLED + 1.0)) :]} == {"found"}
    assert verdicts[0].kind == "lost", "one scan proves nothing"
    assert verdicts[-1].probability > 0.98


@pytest.mark.parametrize("worth", [-1.0, 0.0, 0.4])
def test_a_place_that_explains_no_more_than_chance_is_wrong_however_sure_the_filter_is(worth: float) -> None:
    verdicts = judged(Judge(), 30.0, weight=1.0, places=(1.0,), worth=worth)
    assert {verdict.kind for verdict in verdicts} == {"lost"}
    assert max(verdict.probability for verdict in verdicts) < 0.5


def test_the_better_a_place_explains_and_the_fewer_rivals_it_has_the_more_probable_it_is() -> None:
    by_worth = [judged(Judge(), 10.0, worth=worth)[-1].probability for worth in (-0.5, 0.3, 0.8, 1.0, 1.05)]
    assert by_worth == sorted(by_worth)
    assert by_worth[0] < 0.1 < by_worth[-1]
    by_share = [judged(Judge(), 10.0, weight=w, worth=1.0)[-1].probability for w in (0.02, 0.3, 0.6, 0.89, 0.999)]
    assert by_share == sorted(by_share)
    assert len(set(by_share)) == 5


@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_no_share_of_the_belief_is_too_small_or_too_large_to_be_judged(weight: float) -> None:
    assert 0.0 < judged(Judge(), 1.0, weight=weight)[-1].probability < 1.0


def test_who_has_proved_right_is_believed_for_a_while_and_less_and_less() -> None:
    """Off the map, where nothing explains anything, it is known where the robot is; not forever."""
    judge = Judge()
    assert judged(judge, 30.0)[-1].kind == "found"
    off = judged(judge, 120.0, since=30.0, off=0.95, worth=0.0)
    assert off[0].kind == "off the map"
    kinds = [verdict.kind for verdict in off]
    assert kinds.count("off the map") > 5 * 5
    assert set(kinds[kinds.index("lost") :]) == {"lost"}
    probabilities = [verdict.probability for verdict in off]
    assert probabilities == sorted(probabilities, reverse=True)


def test_half_of_the_belief_must_be_off_the_map() -> None:
    assert judged(Judge(), 5.0, off=0.4)[-1].kind == "found"
    assert judged(Judge(), 5.0, off=0.6)[-1].kind == "off the map"


def test_one_bad_scan_in_a_crowd_changes_nothing() -> None:
    judge = Judge()
    judged(judge, 30.0)
    assert judged(judge, 0.4, since=30.0, worth=-1.0)[-1].kind == "found"


@pytest.mark.parametrize("worth", [0.8, 1.0])
def test_after_a_gap_a_place_has_to_prove_right_again(worth: float) -> None:
    """The same scans count for much, where the place was right just now, and for little where nobody saw the way."""
    driven, carried = Judge(), Judge()
    judged(driven, 30.0)
    judged(carried, 30.0)
    there = dataclasses.replace(GOOD_PLACE, time=30.0, worth=worth)
    stayed, moved = driven.judge(there), carried.judge(dataclasses.replace(there, moved=True))
    assert stayed.kind == "found"
    assert moved.kind == "lost"
    # As if nothing had ever been known.
    first = Judge().judge(there)
    assert moved.probability == first.probability


def test_a_proof_is_forgotten() -> None:
    never, once = Judge(), Judge()
    judged(once, 30.0)
    late = {"since": 30.0 + FORGOTTEN, "worth": 0.9}
    assert judged(never, 60.0, **late)[-1].probability == pytest.approx(judged(once, 60.0, **late)[-1].probability)


def test_who_holds_little_of_the_belief_is_not_probable_however_well_it_explains_a_scan() -> None:
    assert judged(Judge(), 1.0, weight=0.04, worth=3.0)[-1].probability == pytest.approx(0.2)
    assert judged(Judge(), 30.0, weight=0.8, worth=3.0)[-1].probability < SURE


def test_nothing_is_right_of_a_robot_whose_laser_is_mounted_otherwise() -> None:
    judge = Judge()
    judged(judge, 30.0)
    turned = judged(judge, 30.0, since=30.0, turned=True)
    assert max(verdict.probability for verdict in turned) < 0.05
    assert {verdict.kind for verdict in turned} == {"lost"}


def test_a_few_places_that_hold_the_belief_together_are_ambiguous_and_many_are_lost() -> None:
    unsure = {"weight": 0.5, "worth": 0.2}
    assert judged(Judge(), 2.0, **unsure, places=(0.5, 0.45))[-1].kind == "ambiguous"
    assert judged(Judge(), 2.0, **unsure, places=(0.5, 0.3))[-1].kind == "lost"
    assert judged(Judge(), 2.0, **unsure, places=(0.1,) * 10)[-1].kind == "lost"
    # In whatever order: the five best count.
    assert judged(Judge(), 2.0, **unsure, places=(0.01,) * 5 + (0.5, 0.45))[-1].kind == "ambiguous"
    # A single place that explains nothing is no choice between places.
    assert judged(Judge(), 2.0, weight=1.0, worth=-1.0, places=(1.0,))[-1].kind == "lost"
    assert judged(Judge(), 2.0, weight=0.98, worth=-1.0, places=(0.98, 0.02))[-1].kind == "lost"


def test_what_is_sure_is_never_called_ambiguous_and_every_kind_has_a_level_on_a_monitor() -> None:
    verdict = judged(Judge(), 30.0, places=(0.5, 0.5))[-1]
    assert verdict.probability >= SURE
    assert verdict.kind == "found"
    assert set(LEVELS) == set(KINDS)
