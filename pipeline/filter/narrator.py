"""Tells what happens to a belief in sentences: the events of a recording."""

from __future__ import annotations

import dataclasses
import math

from pipeline.filter.contradiction import Contradiction
from pipeline.filter.fates import Fates, clause
from pipeline.filter.recovery import Takeover
from pipeline.filter.step import Event, Step
from pipeline.motion.words import in_words

CONVERGED_SPREAD = 0.5
"""Metres: the belief has converged when its particles lie so close together ..."""
CONVERGED_WEIGHT = 0.95
"""... and one hypothesis holds so much of the weight."""
RESAMPLE_WINDOW = 50
SAID, MOST_SAID = 0.05, 3
"""Share from which on a hypothesis is in the sentence about a gap, and how many are."""


class Narrator:
    """Compares each step with the ones before and adds the events that a reader wants to find on the timeline."""

    def __init__(self) -> None:
        self._started = False
        self._converged = False
        self._lost = False
        self._updates = 0
        self._resampled = 0
        self._pace = ""
        self._contradiction = Contradiction()
        self._fates = Fates()

    def tell(self, step: Step, takeover: Takeover | None) -> Step:
        """The step, with its events. ``takeover``: of the recovery, if any."""
        step = self._fates.name(step)
        events = [
            *_unseen(step),
            *self._search(step),
            *self._start(step),
            *self._health(step, takeover),
            *self._belief(step),
            *self._resampling(step),
            *self._contradiction.hear(step),
        ]
        return dataclasses.replace(step, events=tuple(events))

    def _start(self, step: Step) -> list[Event]:
        if self._started:
            return []
        self._started = True
        return [Event("started", f"Started with {len(step.particles):,} particles, spread {step.spread:.1f} m.")]

    def _search(self, step: Step) -> list[Event]:
        if step.heat is None or not self._started:
            return []
        # What calls for a search is the share of the last scans, not that of this one.
        fit = f"{100 * step.explained:.0f} % of the beams fit now"
        why = f"of late the scans have fitted this place hardly better than chance, and {fit}"
        if step.motion.unseen is not None:
            why = "nobody saw how the robot came here"
        return [Event("searched", f"Searched the building at {step.time:.1f} s: {why}.")]

    def _belief(self, step: Step) -> list[Event]:
        together = step.spread < CONVERGED_SPREAD and step.estimate.weight > CONVERGED_WEIGHT
        if together and not self._converged:
            self._converged = True
            x, y, yaw = step.estimate.pose
            where = f"({x:.2f}, {y:.2f}) m, heading {math.degrees(yaw):.0f} deg"
            return [Event("converged", f"Converged at {step.time:.1f} s on {where}; spread {step.spread:.2f} m.")]
        if self._converged and step.spread > 2 * CONVERGED_SPREAD:
            self._converged = False
            return [Event("diverged", f"Spread out again at {step.time:.1f} s: {step.spread:.1f} m.", "WARN")]
        return []

    def _health(self, step: Step, takeover: Takeover | None) -> list[Event]:
        events = []
        if takeover is not None:
            here = f"{100 * takeover.explained:.0f} % of the beams fit here"
            there = f"a place {takeover.distance:.0f} m away, followed for {takeover.since:.1f} s"
            says = f"at {step.time:.1f} s: {here}, but {there}, fits better by {takeover.lead:.1f} nats."
            events.append(
                Event("changed", f"Still lost {says}") if self._lost else Event("lost", f"Lost {says}", "WARN")
            )
            self._lost = True
        if self._lost and step.estimate.weight > CONVERGED_WEIGHT:
            self._lost = False
            x, y, yaw = step.estimate.pose
            where = f"({x:.2f}, {y:.2f}) m, heading {math.degrees(yaw):.0f} deg"
            name = step.estimate.name
            fate = f": it {clause(name)}" if name else ""
            events.append(Event("found", f"Found again at {step.time:.1f} s on {where}{fate}."))
        return events

    def _resampling(self, step: Step) -> list[Event]:
        self._updates += step.moved
        self._resampled += step.resampled
        if self._updates < RESAMPLE_WINDOW:
            return []
        share = self._resampled / self._updates
        self._updates = self._resampled = 0
        pace = "rarely" if share < 0.1 else "often" if share > 0.5 else "now and then"
        if pace == self._pace:
            return []
        self._pace = pace
        often = f"at {100 * share:.0f} % of the last {RESAMPLE_WINDOW} updates"
        return [Event("resampled", f"Resamples {pace} at {step.time:.1f} s: {often}.")]


def _unseen(step: Step) -> list[Event]:
    """What is missing in the log before this scan, or wrong, so that nobody saw the robot's way."""
    gap, at = step.motion.gap, f"{step.time:.1f} s"
    events = [Event(fault.kind, fault.text, "WARN") for fault in step.motion.faults]
    if gap is None or gap.kind == "sparse":
        return events
    said = "the wheels say nothing" if gap.told is None else f"the wheels say {in_words(gap.told, 1)}"
    so = "so the robot drove on" if gap.driven else "so the robot may have been carried anywhere"
    if gap.bridged:
        so = "but the laser sees the walls that it saw before, so nothing is lost"
    seen = f"{gap.seconds:.0f} s are missing before {at}"
    if gap.kind == "unmatched":
        seen = f"The laser sees other walls at {at} than just before"
    text = f"{seen}; {said}, {so}.{_believed(step)}"
    return [*events, Event("gap", text, "INFO" if gap.bridged else "WARN")]


def _believed(step: Step) -> str:
    """How the belief is shared out among what may have become of the robot; empty if that is no question."""
    shares: dict[str, float] = {}
    for hypothesis in step.clusters:
        if hypothesis.name and hypothesis.weight >= SAID:
            shares[hypothesis.name] = shares.get(hypothesis.name, 0.0) + hypothesis.weight
    told = [f"{100 * share:.0f} % that it {clause(name)}" for name, share in shares.items()]
    return f" Believed: {', '.join(told[:MOST_SAID])}." if told else ""
