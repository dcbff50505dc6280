"""What happens to a belief in sentences: a loss is told once, and after a gap every hypothesis has a name."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.filter.narrator import Narrator
from pipeline.filter.recovery import Takeover
from pipeline.filter.step import Beams, Estimate, Event, Step
from pipeline.geometry import compose
from pipeline.judgement.verdict import Verdict
from pipeline.motion.gaps import Gap
from pipeline.motion.witnesses import Motion

TAKEOVER = Takeover(lead=3.0, since=1.0, distance=9.0, explained=0.6)
HERE, WAY = np.array([3.0, 2.0, 0.5]), np.array([2.0, 0.0, 1.0])
THERE, ELSEWHERE = compose(HERE, WAY), np.array([12.0, 9.0, 2.0])


def told(wheels: np.ndarray | None, kind: str = "missing", bridged: bool = False) -> Gap:
    return Gap(kind, 20.0, wheels, bridged)  # type: ignore[arg-type]


def step(at: int, places: list[tuple[np.ndarray, float]], pose: np.ndarray, gap: Gap | None = None) -> Step:
    """A scan at which the belief is at these places with these weights, and dead reckoning has come to ``pose``."""
    clusters = tuple(Estimate(place, np.eye(3) * 0.01, weight) for place, weight in places)
    motion = Motion(float(at), pose, None, None, pose, np.empty(0, np.float32), gap=gap)
    return Step(
        index=at, stamp=at, time=float(at), particles=np.empty((9, 3), np.float32), log_weights=np.zeros(9),
        estimate=clusters[0], clusters=clusters, ess=9.0,
        beams=Beams(pose, np.empty(0), *2 * [np.empty(0, np.float32)]),
        mean_likelihood=1.0, explained=0.7, spread=0.7, moved=True, resampled=False, motion=motion,
        verdict=Verdict("found", 1.0),
    )  # fmt: skip


def sentences(events: tuple[Event, ...], kind: str) -> list[str]:
    return [event.text for event in events if event.kind == kind]


def after_gap(gap: Gap, places: list[tuple[np.ndarray, float]]) -> tuple[Narrator, Step]:
    narrator = Narrator()
    narrator.tell(step(0, [(HERE, 1.0)], np.zeros(3)), None)
    return narrator, narrator.tell(step(20, places, np.array([0.0, 0.0, 0.3]), gap), None)


def test_a_loss_is_told_once_until_the_robot_is_found() -> None:
    narrator, at_two = Narrator(), [(HERE, 0.6), (ELSEWHERE, 0.4)]
    takeovers = [None, TAKEOVER, None, TAKEOVER, None, TAKEOVER]
    places = [at_two, at_two, at_two, at_two, [(HERE, 0.97), (ELSEWHERE, 0.03)], at_two]
    steps = [narrator.tell(step(k, p, np.zeros(3)), v) for k, (p, v) in enumerate(zip(places, takeovers, strict=True))]
    kinds = [[event.kind for event in s.events if event.kind in ("lost", "changed", "found")] for s in steps]
    assert kinds == [[], ["lost"], [], ["changed"], ["found"], ["lost"]]
    assert sentences(steps[1].events, "lost")[0].startswith("Lost at 1.0 s: 60 % of the beams fit here, but a place")
    assert sentences(steps[3].events, "changed")[0].startswith("Still lost at 3.0 s:")


def test_hypotheses_after_a_gap_have_names() -> None:
    _, first = after_gap(told(WAY), [(THERE, 0.5), (HERE, 0.3), (ELSEWHERE, 0.2)])
    assert [c.name for c in first.clusters] == ["drove on as the wheels say", "did not move", "carried off to 12, 9"]
    assert first.estimate.name == "drove on as the wheels say"
    (gap,) = sentences(first.events, "gap")
    assert gap.endswith(
        "so the robot drove on. Believed: 50 % that it drove on as the wheels say, 30 % that it did not move, "
        "20 % that it was carried off to 12, 9."
    )


def test_names_stay_while_the_robot_drives_on_and_go_when_one_is_left() -> None:
    moved = np.array([5.0, -1.0, 0.7])
    narrator, _ = after_gap(told(np.zeros(3)), [(HERE, 0.6), (ELSEWHERE, 0.4)])
    on = compose(np.array([0.0, 0.0, 0.3]), moved)
    here, elsewhere = compose(HERE, moved), compose(ELSEWHERE, moved)
    later = narrator.tell(step(25, [(elsewhere, 0.7), (here, 0.3)], on), TAKEOVER)
    assert [c.name for c in later.clusters] == ["carried off to 12, 9", "did not move"]
    last = narrator.tell(step(26, [(elsewhere, 0.98), (here, 0.02)], on), None)
    assert sentences(last.events, "found")[0].endswith(": it was carried off to 12, 9.")
    after = narrator.tell(step(27, [(elsewhere, 0.7), (here, 0.3)], on), None)
    assert [c.name for c in after.clusters] == ["", ""]


@pytest.mark.parametrize("gap", [told(WAY, bridged=True), told(WAY, kind="sparse"), None])
def test_where_nothing_is_open_nothing_is_named(gap: Gap | None) -> None:
    _, now = after_gap(gap, [(THERE, 0.6), (HERE, 0.4)])  # type: ignore[arg-type]
    assert [c.name for c in now.clusters] == ["", ""]
    assert not any("Believed" in event.text for event in now.events)


def test_without_wheels_nobody_says_that_it_drove_on() -> None:
    _, now = after_gap(told(None), [(THERE, 0.6), (HERE, 0.4)])
    assert [c.name for c in now.clusters] == ["carried off to 5, 3", "did not move"]
