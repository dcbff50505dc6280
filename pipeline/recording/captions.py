"""What is the matter at a scan, in words: a headline and a few sentences, for someone who was not there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from string import ascii_uppercase

import numpy as np
from numpy.typing import NDArray

from pipeline.filter.step import Estimate, Event, Step
from pipeline.geometry import wrap_angle
from pipeline.judgement.verdict import SURE, TRUSTED

RIGHT = (0.5, np.radians(10.0))  # m, rad: an estimate nearer to the truth than this is right
WORTH_A_NAME = 0.05
"""Share from which on a hypothesis has a letter that the sentences use."""
MUCH_SHORT, MUCH_THROUGH = 0.25, 0.1
"""Shares of the beams from which on what stands in the way, or is gone, is worth a sentence in bold."""
JUST = 1.0  # s for which a search of the building is news
WIDE = 2.0  # m: particles that spread so far are all over the place
OFF = 0.5  # share of the belief that is off the map
EVENTS_KEPT = 6
LEFT_OUT = ("resampled",)
"""Kinds of events that matter to who tunes a filter, and not to who asks what happened."""


@dataclass(frozen=True)
class Error:
    """How far an estimate is from the truth: ``distance`` m, ``turn`` rad, at least 0."""

    distance: float
    turn: float

    @property
    def right(self) -> bool:
        """Whether that counts as being there."""
        return self.distance <= RIGHT[0] and self.turn <= RIGHT[1]

    def __str__(self) -> str:
        return f"{self.distance:.2f} m and {math.degrees(self.turn):.0f}°"


def error(estimate: NDArray[np.float64], truth: NDArray[np.float64]) -> Error:
    """Between two poses (3,) in the map."""
    turn = abs(float(wrap_angle(estimate[2] - truth[2])))
    return Error(float(np.hypot(*(estimate[:2] - truth[:2]))), turn)


def two_sigma(estimate: Estimate) -> float:
    """Twice the deviation of the position along the ellipse's longer axis, m."""
    return 2.0 * math.sqrt(max(float(np.linalg.eigvalsh(estimate.covariance[:2, :2])[-1]), 0.0))


def letter(hypotheses: Sequence[Estimate], which: int) -> str:
    """What a hypothesis of several is called: A the heaviest; empty where its share is not worth a name."""
    named = len(hypotheses) > 1 and which < len(ascii_uppercase) and hypotheses[which].weight >= WORTH_A_NAME
    return ascii_uppercase[which] if named else ""


class Captions:
    """Hears the steps in their order, and says of each what is the matter."""

    def __init__(self) -> None:
        self._known = False
        self._carried: float | None = None
        self._unseen: float | None = None
        self._searched = -math.inf
        self._events: list[tuple[float, Event]] = []

    def caption(self, step: Step, missed: Error | None, carried: bool = False) -> str:
        """In Markdown. ``missed``: the error, where the truth is known; ``carried``: the truth leapt to here."""
        if carried:
            self._carried = step.time
        if missed is not None and missed.right:
            self._carried = None
        if step.heat is not None:
            self._searched = step.time
        if any(event.kind == "gap" and event.level == "WARN" for event in step.events):
            self._unseen = step.time
        elif step.verdict.kind in TRUSTED:
            self._unseen = None
        told = f"# {self._headline(step, missed)}\n{_beams(step)} {_belief(step)}{_off_by(step, missed)}"
        self._known |= step.verdict.kind in TRUSTED
        return told

    def events(self, step: Step) -> str | None:
        """A table of what happened last, the newest first, in Markdown; None if nothing happened at this scan."""
        news = [(step.time, event) for event in reversed(step.events) if event.kind not in LEFT_OUT]
        if not news:
            return None
        self._events = [*news, *self._events][:EVENTS_KEPT]
        rows = [f"| {time:.1f} s | {event.kind} | {event.text} |" for time, event in self._events]
        return "\n".join(["| time | what | why |", "|---|---|---|", *rows])

    def _headline(self, step: Step, missed: Error | None) -> str:
        kind, wrong = step.verdict.kind, missed is not None and not missed.right
        if kind in TRUSTED and wrong:
            assert missed is not None
            away = f"it is {missed.distance:.1f} m away from where it believes to be"
            if missed.distance <= RIGHT[0]:
                away = f"it is turned by {math.degrees(missed.turn):.0f}° from what it believes"
            if self._carried is not None:
                return f"CARRIED OFF at {self._carried:.0f} s, and does not know it yet: {away}"
            return f"WRONG, and does not know it: {away}"
        if kind == "found":
            known = "FOUND: it knows where it is"
            if step.short >= MUCH_SHORT:
                return f"{known}, though something stands in the way of {_percent(step.short)} of the beams"
            if step.through >= MUCH_THROUGH:
                return f"{known}, though {_percent(step.through)} of the beams go through mapped walls"
            return f"{known}, and its place follows the robot"
        if kind == "off the map":
            return "OFF THE MAP: it drives where the map knows nothing; how it came there tells where it is"
        if kind == "ambiguous":
            best = [c for c in step.clusters if c.weight >= WORTH_A_NAME]
            return f"AMBIGUOUS: {len(best) if len(best) > 1 else 'a few'} places explain the scans about alike"
        if step.off_map > OFF:
            return "LOST OFF THE MAP: it drives where the map knows nothing, and the best guess may be wrong"
        since = "not found yet"
        if self._carried is not None:
            since = f"carried off at {self._carried:.0f} s"
        elif self._unseen is not None:
            since = f"perhaps carried off before {self._unseen:.0f} s, where scans are missing"
        elif self._known:
            since = "it was known before"
        if step.time - self._searched <= JUST or step.spread > WIDE:
            return f"LOST: {since}; the whole map is being searched"
        return f"LOST: {since}; it is sought, and the best guess may be wrong"


def silence(seconds: float) -> str:
    """The caption of a time in which the log says nothing, for so many seconds."""
    return (
        f"# NOTHING IS KNOWN: the log has no scans for {seconds:.0f} s\n"
        "The robot was switched off, or carried, or the recorder stopped. What is drawn is the last scan before."
    )


def _beams(step: Step) -> str:
    rest = []
    if step.short >= 0.01:
        much = step.short >= MUCH_SHORT and step.off_map <= OFF
        why = " (a shut door, furniture or people in the way)" if much else ""
        rest.append(_stressed(f"{_percent(step.short)} stop short of the mapped walls{why}", bool(why)))
    if step.through >= 0.01:
        why = " (an open door, a wall that is gone, or another place)" if step.through >= MUCH_THROUGH else ""
        rest.append(_stressed(f"{_percent(step.through)} pass through a mapped wall{why}", bool(why)))
    fit = _stressed(f"{_percent(step.explained)} of the beams fit the map", step.explained < 0.5)
    return "; ".join([f"At the best guess {fit}", *rest]) + "."


def _belief(step: Step) -> str:
    named = [(letter(step.clusters, k), c) for k, c in enumerate(step.clusters) if letter(step.clusters, k)]
    if len(named) > 1:
        shares = ", ".join(f"{name} {_percent(c.weight)}" for name, c in named[:5])
        return f"Places in question, with their shares of the belief: {shares}."
    if len(step.clusters) > 1 and step.estimate.weight < 0.9:
        best = _percent(step.estimate.weight)
        return f"The best guess holds {best} of the belief, {len(step.clusters) - 1} other places the rest."
    probability = f"It is right with a probability of {_percent(step.verdict.probability)}"
    return f"{probability}." if step.verdict.kind in TRUSTED else f"{probability}; found is from {_percent(SURE)} on."


def _off_by(step: Step, missed: Error | None) -> str:
    if missed is None:
        return f" Uncertain by {two_sigma(step.estimate):.2f} m (2 sigma)."
    return f" From the truth (green) it is {missed} away; it admits {two_sigma(step.estimate):.2f} m (2 sigma)."


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _stressed(text: str, yes: bool) -> str:
    return f"**{text}**" if yes else text
