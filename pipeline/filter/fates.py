"""What may have become of the robot while nobody saw it: each hypothesis after a gap has a name until one is left."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from pipeline.filter.step import Estimate, Step
from pipeline.geometry import between, compose, inverse, wrap_angle
from pipeline.motion.prior import GAP_A, GAP_D

DROVE_ON, STAYED, CARRIED = "drove on as the wheels say", "did not move", "carried off"
NEAR_D, NEAR_A = 2.0 * GAP_D, 2.0 * GAP_A
"""m, rad: as near as that to where the wheels say, or to where it was, a hypothesis says the same."""
DECIDED = 0.95
"""Share of the belief at one place from which on nothing is left to be told apart."""

Array = NDArray[np.float64]


class Fates:
    """Follows the steps of a run in their order."""

    def __init__(self) -> None:
        self._before: Array | None = None
        self._gap_at: Array | None = None
        self._places: list[tuple[str, Array]] = []

    def name(self, step: Step) -> Step:
        """The step, with names for its hypotheses while the contest after a gap is open."""
        motion, gap = step.motion, step.motion.unseen
        if gap is not None and gap.kind != "sparse" and self._before is not None:
            self._gap_at, self._places = motion.pose, [(STAYED, self._before)]
            if gap.told is not None and gap.driven:
                self._places.insert(0, (DROVE_ON, compose(self._before, gap.told)))
        self._before = step.estimate.pose
        if self._gap_at is None:
            return step
        since = between(self._gap_at, motion.pose)
        clusters = tuple(dataclasses.replace(each, name=self._name(each, since)) for each in step.clusters)
        if step.estimate.weight > DECIDED:
            self._gap_at = None
        return dataclasses.replace(step, clusters=clusters, estimate=clusters[0])

    def _name(self, hypothesis: Estimate, since: Array) -> str:
        """``since``: how the robot has moved from the gap until now."""
        there = compose(hypothesis.pose, inverse(since))
        for name, place in self._places:
            near = math.hypot(*(there - place)[:2]) < NEAR_D and abs(float(wrap_angle(there[2] - place[2]))) < NEAR_A
            if near:
                return name
        x, y = (round(float(value)) for value in there[:2])
        return f"{CARRIED} to {x}, {y}"


def clause(name: str) -> str:
    """The name of a hypothesis as it follows "that it"."""
    return f"was {name}" if name.startswith(CARRIED) else name
