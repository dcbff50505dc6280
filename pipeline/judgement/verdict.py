"""The verdict on every scan: found, ambiguous, off the map, or lost, and how probable it is that the pose is right."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

Kind = Literal["found", "ambiguous", "off the map", "lost"]
KINDS: tuple[Kind, ...] = get_args(Kind)
TRUSTED: tuple[Kind, ...] = ("found", "off the map")

SURE = 0.9
"""Probability from which on the robot is found; or, where the map ends, off it and known to be there."""
FEW = 5
"""Places among which an ambiguous belief is divided: if they hold SURE of it together, it is one of them."""
OFF = 0.5
"""Share of the belief that must be off the map."""
SMOOTH, SLOWLY = 2.0, 20.0
"""s over which what the beams are worth is smoothed: one scan may see a crowd; and a place proves right slowly."""
GOOD = 1.1
"""Nats a beam by which a place must explain the scans better than chance, over both, to prove right."""
SETTLED = 2.0
"""s for which the estimate must have held SURE of it all until its place can prove right: one good scan proves nothing,
least of all the one in which another place takes over."""
FORGOTTEN = 200.0
"""s after which it says nothing more that a place had proved right."""
PRIOR, SHARE, WORTH, PROVED = 3.42, 0.24, 1.66, -1.11
"""Logistic regression of "within 0.5 m and 10 degrees" on the signs: constant, logit of the estimate's share, nats a
beam, and the logarithm of the seconds since the place had proved right; all runs weigh the same (docs/verdict.md)."""


TURNED = 0.01
"""Probability that a heading is right of a robot whose laser is mounted otherwise than the log says."""


@dataclass(frozen=True)
class Signs:
    """What a scan gives to judge by: ``time`` s; ``weight``: the estimate's share of belief and rivals; ``worth``: nats
    a beam by which the place explains the scan better than a reading of this laser is probable on average; ``off``:
    share of the belief that is off the map; ``places``: shares of the best few places; ``moved``: nobody saw the way
    here, or another place has taken the belief's; ``turned``: the laser is mounted otherwise than the log says."""

    time: float
    weight: float
    worth: float
    off: float
    places: tuple[float, ...]
    moved: bool
    turned: bool = False


@dataclass(frozen=True)
class Verdict:
    """``probability``: that the estimate is within 0.5 m and 10 degrees of the truth. Of the scans that get 0.9, about
    nine in ten are (docs/verdict.md)."""

    kind: Kind
    probability: float


class Judge:
    """Hears the signs of every scan in their order, and says what can be trusted.

    What counts is what a place explains against chance and against its rivals, and for how long it has not been
    so good as to prove right: a robot that drives off the map, or into a crowd, is where it was known to be before.
    """

    def __init__(self) -> None:
        self._worth = self._slowly = 0.0
        self._time: float | None = None
        self._proved = -math.inf
        self._contested = 0.0

    def judge(self, signs: Signs) -> Verdict:
        """The verdict on one scan."""
        probability = float(stated(*self.regressors(signs)))
        if signs.turned:
            probability = min(probability, TURNED)
        return Verdict(_kind(signs, probability), probability)

    def regressors(self, signs: Signs) -> tuple[float, float, float]:
        """What SHARE, WORTH and PROVED weigh, of one scan and of those before it."""
        if signs.moved or self._time is None:
            self._worth = self._slowly = signs.worth
            self._proved = -math.inf
        else:
            seconds = signs.time - self._time
            self._worth += -math.expm1(-seconds / SMOOTH) * (signs.worth - self._worth)
            self._slowly += -math.expm1(-seconds / SLOWLY) * (signs.worth - self._slowly)
        self._time = signs.time
        if signs.moved or signs.weight <= SURE:
            self._contested = signs.time
        if signs.time - self._contested > SETTLED and min(self._worth, self._slowly) > GOOD:
            self._proved = signs.time
        share = min(max(signs.weight, 0.001), 0.999)
        since = min(signs.time - self._proved, FORGOTTEN)
        return math.log(share / (1.0 - share)), self._worth, math.log1p(since)


def stated(share: ArrayLike, worth: ArrayLike, since: ArrayLike) -> NDArray[np.float64]:
    """The probability that an estimate is right, by what ``Judge.regressors`` gives: all (n,), or single numbers.

    It is at most the root of the estimate's share of the belief: where the best of many places has 4 %, however well it
    explains one scan, others explain it as well.
    """
    score = PRIOR + SHARE * np.asarray(share) + WORTH * np.asarray(worth) + PROVED * np.asarray(since)
    by_signs, of_belief = (1.0 / (1.0 + np.exp(-np.clip(x, -20.0, 20.0))) for x in (score, np.asarray(share)))
    return np.asarray(np.minimum(by_signs, np.sqrt(of_belief)))


def _kind(signs: Signs, probability: float) -> Kind:
    if probability >= SURE:
        return "off the map" if signs.off > OFF else "found"
    best = sorted(signs.places, reverse=True)[:FEW]
    if best and best[0] < SURE <= sum(best):
        return "ambiguous"
    return "lost"
