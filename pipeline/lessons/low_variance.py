"""Lesson 4.4: low-variance resampling."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipeline.lessons.exam import Array, Function, Question, Unusable, called, numbers, shaped
from pipeline.lessons.lesson import Lesson, Mistake

DRAWS = 400
"""How often every set of weights is drawn from."""
SURE = 6.0
"""Standard errors by which an answer may differ: of a hundred right answers, one in a million does by chance."""


def low_variance_sampler(weights: Array, rng: np.random.Generator) -> NDArray[np.int64]:
    """Choose which particles survive, by one random number and equal steps (Probabilistic Robotics, Table 4.4).

    weights: (n,) float64, of the particles, summing to one; some may be zero.
    rng: numpy's Generator, from which the one random number is drawn: rng.uniform(0.0, 1.0 / n).
    Returns (n,) int: the indices of the particles that survive, counted from 0, one that survives several times as
        often as it does. Their order does not matter.
    """
    n = len(weights)
    r = rng.uniform(0.0, 1.0 / n)
    survivors = np.empty(n, np.int64)
    i = 0
    c = weights[0]
    for m in range(n):
        u = r + m / n
        while u > c and i < n - 1:
            i += 1
            c += weights[i]
        survivors[m] = i
    return survivors


_WEIGHTS: dict[str, tuple[float, ...]] = {
    "uneven weights": (0.02, 0.31, 0.05, 0.17, 0.09, 0.21, 0.04, 0.11),
    "a heavy particle": (0.03, 0.04, 0.78, 0.02, 0.06, 0.07),
    "weights of zero": (0.0, 0.25, 0.0, 0.4, 0.0, 0.0, 0.35, 0.0),
    "equal weights": (0.2, 0.2, 0.2, 0.2, 0.2),
}


class Combs:
    """Sets of weights are drawn from many times.

    Each draw must be one that a comb with equal steps can make, and each of these must come as often as its share of
    the places where the comb may begin; up to what chance allows.
    """

    @cached_property
    def _outcomes(self) -> list[dict[tuple[int, ...], float]]:
        return [_outcomes(np.array(weights)) for weights in _WEIGHTS.values()]

    @cached_property
    def questions(self) -> Sequence[Question]:
        """What each number is."""
        asked = []
        for (group, weights), outcomes in zip(_WEIGHTS.items(), self._outcomes, strict=True):
            names = [f"copies of particle {k}, of weight {w:g}, in the mean" for k, w in enumerate(weights)]
            names += ["share of the draws that no comb with equal steps makes"]
            names += [f"how often {list(outcome)} survive" for outcome in outcomes]
            asked += [Question(group, name) for name in names]
        return asked

    @cached_property
    def expected(self) -> Array:
        """By the shares of the places where the comb may begin."""
        rows: list[float] = []
        for weights, outcomes in zip(_WEIGHTS.values(), self._outcomes, strict=True):
            rows += [len(weights) * w for w in weights] + [0.0] + list(outcomes.values())
        return np.array(rows)

    @cached_property
    def tolerance(self) -> Array:
        """So many standard errors, of so many draws."""
        rows: list[float] = []
        for weights, outcomes in zip(_WEIGHTS.values(), self._outcomes, strict=True):
            part = np.modf(len(weights) * np.array(weights))[0]
            shares = np.array(list(outcomes.values()))
            # Where rounding decides on which particle a tooth stands, a draw in a thousand may differ.
            rows += [*(1e-3 + SURE * np.sqrt(part * (1 - part) / DRAWS)), 2e-3]
            rows += [*(1e-3 + SURE * np.sqrt(shares * (1 - shares) / DRAWS))]
        return np.array(rows)

    def ask(self, function: Function) -> Array:
        """What the function draws. Raises Unusable."""
        answers: list[float] = []
        for weights, outcomes in zip(_WEIGHTS.values(), self._outcomes, strict=True):
            n, rng, drawn = len(weights), np.random.default_rng([4, 4, len(weights)]), []
            for _ in range(DRAWS):
                arguments = (np.array(weights), rng)
                drawn.append(_indices(called(function, arguments), n, arguments))
            copies = np.array([np.bincount(row, minlength=n) for row in drawn])
            told = [tuple(sorted(row.tolist())) for row in drawn]
            shares = [told.count(outcome) / DRAWS for outcome in outcomes]
            answers += [*copies.mean(axis=0), 1.0 - sum(shares), *shares]
        return np.array(answers)


def _indices(result: object, n: int, arguments: Sequence[object]) -> NDArray[np.int64]:
    found = shaped(numbers(result, "the result", arguments), (n,), "the result", arguments)
    if not np.isfinite(found).all() or (found != np.round(found)).any():
        raise Unusable("indices of particles should be whole numbers, and some are not", arguments)
    if found.min() < 0 or found.max() > n - 1:
        wrong = found.min() if found.min() < 0 else found.max()
        raise Unusable(f"of {n} particles, with indices 0 to {n - 1}, the index {wrong:.0f} survived", arguments)
    return found.astype(np.int64)


def _outcomes(weights: Array) -> dict[tuple[int, ...], float]:
    """What a comb may choose, and with which probability: between two places where a tooth passes a border of the
    cumulative weights, it is always the same."""
    n, cumulative = len(weights), np.cumsum(weights)
    borders = np.unique(np.round(np.append(cumulative % (1.0 / n), [0.0, 1.0 / n]), 9))
    outcomes: dict[tuple[int, ...], float] = {}
    for low, high in itertools.pairwise(borders):
        if high - low > 1e-6:
            teeth = (low + high) / 2 + np.arange(n) / n
            chosen = tuple(np.searchsorted(cumulative, teeth).tolist())
            outcomes[chosen] = outcomes.get(chosen, 0.0) + float(high - low) * n
    return outcomes


LESSON = Lesson(
    name="4.4",
    title="Low-variance resampling",
    source="Probabilistic Robotics, Section 4.3 and Table 4.4",
    task=(
        "Particles of much weight shall go on in several copies, those of little in none. Lay the weights side by "
        "side, so that they cover the line from 0 to 1, and put a comb with n teeth, 1/n apart, on it: whatever "
        "particle a tooth stands on survives. One random number, between 0 and 1/n, says where the first tooth "
        "stands. So a particle of weight w survives in n w copies, rounded up or down, and never in more or fewer. "
        "Mind that the book counts from 1."
    ),
    reference=low_variance_sampler,
    exam=Combs(),
    mistakes=(
        Mistake(
            "the comb begins one step too late: the book's m counts from 1", {"u = r + m / n": "u = r + (m + 1) / n"}
        ),
        Mistake("the indices count from 1", {"survivors[m] = i": "survivors[m] = i + 1"}),
        Mistake("the indices are one too low", {"survivors[m] = i": "survivors[m] = max(i - 1, 0)"}),
        Mistake(
            "the random number lies between 0 and 1, and not between 0 and 1/n",
            {"rng.uniform(0.0, 1.0 / n)": "rng.uniform(0.0, 1.0)"},
        ),
        Mistake(
            "a random number is drawn for each tooth, so that the steps are not equal",
            {"u = r + m / n": "u = rng.uniform(0.0, 1.0 / n) + m / n"},
        ),
        Mistake(
            "every survivor is drawn independently: this is multinomial resampling",
            {"    return survivors": "    return rng.choice(n, n, p=weights / weights.sum())"},
        ),
        Mistake("there is no random number", {"rng.uniform(0.0, 1.0 / n)": "0.0"}),
        Mistake("the first tooth is always in the middle of its step", {"rng.uniform(0.0, 1.0 / n)": "0.5 / n"}),
        Mistake(
            "the sum of the weights is not kept up to date in the loop",
            {"            c += weights[i]": "            c = weights[i]"},
        ),
        Mistake(
            "the sum begins with nothing, where it should begin with the first weight", {"c = weights[0]": "c = 0.0"}
        ),
        Mistake(
            "the weight is added before the index goes on, so that the first one counts twice",
            {"            i += 1\n            c += weights[i]": "            c += weights[i]\n            i += 1"},
        ),
        Mistake(
            "the index goes on by at most one for every tooth: a while is needed, and not an if",
            {"while u > c and i < n - 1": "if u > c and i < n - 1"},
        ),
        Mistake("the comparison is the wrong way round", {"while u > c and": "while u < c and"}),
        Mistake("the steps are 1 / (n - 1) long, and not 1 / n", {"u = r + m / n": "u = r + m / (n - 1)"}),
        Mistake("all particles survive once, whatever they weigh", {"survivors[m] = i": "survivors[m] = m"}),
    ),
)
